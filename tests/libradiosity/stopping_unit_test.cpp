/// Long loops ask whether to stop between their items, those too that report no progress.
#include <gtest/gtest.h>

#include <atomic>
#include <vector>

#include "libradiosity/light_map.h"
#include "libradiosity/patch_mesh.h"
#include "libradiosity/solve_stored.h"
#include "libscene/parallel.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

constexpr int kSide = 1024;  // 256 tiles: more than the parts that a pilot's sums have

/// A run that is told to stop after so many asks.
struct Stopped {
  explicit Stopped(int after) {
    run.threads = 2;
    run.stop = [this, after] { return ++asked > after; };
  }
  std::atomic<int> asked = 0;
  Run run;
};
constexpr int kNever = 1 << 30;

struct Room {
  Room() : charts(findCharts(scene, kSide, {})), texels(scene, charts, kSide), map(startMap(scene, texels, {})) {}
  Scene scene = test::litRoom();
  Charts charts;
  TexelMap texels;
  Tracer tracer{scene};
  DirectLight direct{scene, tracer, true};
  LightMap map;
};

/// How often the whole of `work` asks; and that it ends where it is told to at a half of that.
template <class Work>
int asks(const Work& work) {
  Stopped never(kNever);
  withThreads(never.run, [&] { work(never.run); });
  const int all = never.asked;
  Stopped halfway(all / 2);
  EXPECT_THROW(withThreads(halfway.run, [&] { work(halfway.run); }), Cancelled);
  // Each thread asks once more at the most.
  EXPECT_LE(halfway.asked, all / 2 + 2);
  return all;
}

TEST(Stopping, ALoopIsStoppedByAnyThreadBetweenItems) {
  EXPECT_GE(asks([](const lmc::Run& run) { parallelFor(run, 1000, 1, [](std::size_t) {}); }), 1000);
  EXPECT_GE(asks([](const lmc::Run& run) { parallelFor(run.quiet(), 1000, 1, [](std::size_t) {}); }), 1000);
  EXPECT_GE(asks([](const lmc::Run& run) { parallelFor(run.silent().part(0.2, 0.4), 1000, 1, [](std::size_t) {}); }), 1000);
}

TEST(Stopping, APartKeepsToItsShare) {
  lmc::Run run;
  std::vector<double> shares;
  run.onProgress = [&](double share) { shares.push_back(share); };
  run.part(0.2, 0.4).part(0.5, 1.0).progress(0.5);
  run.part(0.2, 0.4).quiet().progress(0.5);
  ASSERT_EQ(shares.size(), 1u);
  EXPECT_DOUBLE_EQ(shares[0], 0.35);
}

TEST(Stopping, ThePilotOfDirectLightAsksBetweenTiles) {
  Room r;
  EXPECT_GE(asks([&](const lmc::Run& run) { pilotDirect(r.map, r.scene, r.texels, r.direct, {}, run); }), int(r.texels.tileCount()));
}

TEST(Stopping, TheForecastOfTheGatherAsksBetweenTiles) {
  Room r;
  const Gather gather(r.scene, r.tracer, r.direct, nullptr, false, 1);
  MapOptions options;
  options.sampled = 0.1;
  const int all = asks([&](const lmc::Run& run) {
    LightMap sample = r.map;
    foretellHemisphere(
        sample, r.scene, r.texels, r.tracer, gather, options, [] {}, run.silent());
  });
  EXPECT_GE(all, int(r.texels.tileCount()));
}

TEST(Stopping, PassesOverStoredRaysAsk) {
  Room r;
  PatchMesh mesh = makePatches(r.scene, {.size_m = 0.1f}, {});
  exposePatches(mesh, r.scene, r.tracer, {});
  ASSERT_GT(mesh.patches.size(), 1000u);
  PatchLight light;
  light.direct.assign(mesh.patches.size(), Rgb(1.0f));
  light.sky.assign(mesh.patches.size(), Rgb(0.0f));
  EXPECT_GE(asks([&](const lmc::Run& run) { solveStored(r.scene, r.tracer, mesh, light, {}, run.silent()); }), 20);
}

}  // namespace
}  // namespace lmc
