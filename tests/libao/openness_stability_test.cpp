/// The same comes out for other thread counts; rays do not hang on when they were asked for.
#include <gtest/gtest.h>

#include <cmath>

#include "libao/hemisphere.h"
#include "libradiosity/light_map.h"
#include "libscene/constants.h"
#include "libscene/parallel.h"
#include "libscene/scene_builder.h"

namespace lmc::ao {
namespace {

Scene tables() {
  SceneBuilder b;
  const std::uint32_t m = b.material(Rgb(0.5f));
  b.quad({-2, 0, -2}, {0, 0, 4}, {4, 0, 0}, m);
  for (int i = 0; i < 5; ++i) b.quad({-1.8f + 0.7f * float(i), 0.2f + 0.1f * float(i), -1}, {0.5f, 0, 0}, {0, 0, 2}, m);
  return b.scene;
}

Openness bake(const Scene& scene, int threads, const Options& options) {
  Run run;
  run.threads = threads;
  Openness out;
  withThreads(run, [&] {
    const Charts charts = findCharts(scene, 96, run);
    const TexelMap map(scene, charts, 96);
    out = bakeMap(scene, map, startMap(scene, map, run).chart, Tracer(scene), options, run);
  });
  return out;
}

TEST(Openness, IsTheSameBytesForAnyNumberOfThreads) {
  const Scene scene = tables();
  const Options options{.error = 0.005, .bent = true};
  const Openness one = bake(scene, 1, options);
  for (const int threads : {2, 7}) {
    const Openness many = bake(scene, threads, options);
    EXPECT_EQ(one.cosine, many.cosine);
    EXPECT_EQ(one.uniform, many.uniform);
    EXPECT_EQ(one.error, many.error);
    EXPECT_EQ(one.bent, many.bent);
    EXPECT_EQ(one.rays, many.rays);
    EXPECT_EQ(one.rmsError, many.rmsError);
  }
}

TEST(Hemisphere, RaysAreTheSameWheneverTheyAreAskedFor) {
  const Scene scene = tables();
  const Tracer tracer(scene);
  const Options options;
  const Hemisphere hemisphere(tracer, options);
  SurfacePoint p;
  p.normal = p.geometricNormal = {0, 1, 0};
  const Places places{[&](glm::vec2 u) {
    SurfacePoint moved = p;
    moved.position_m = {double(u.x), 0.0, double(u.y)};
    return moved;
  }};
  Sums atOnce, inParts;
  hemisphere.cast(5, 512, places, atOnce, nullptr);
  for (const std::uint32_t until : {16u, 48u, 48u, 304u, 512u}) hemisphere.cast(5, until, places, inParts, nullptr);
  for (std::size_t h = 0; h < 2; ++h) {
    EXPECT_EQ(atOnce.halves[h].cosine, inParts.halves[h].cosine);
    EXPECT_EQ(atOnce.halves[h].blockedCosine, inParts.halves[h].blockedCosine);
    EXPECT_EQ(atOnce.halves[h].blockedUniform, inParts.halves[h].blockedUniform);
    EXPECT_GT(atOnce.halves[h].blockedCosine, 0.0f);
  }
}

TEST(Openness, ASmallHoleInAClosedBoxIsNotLost) {
  // 6 x 6 cm in a ceiling of 2 x 2 m: few of the first rays find it. Where it is seen, neighbours' finds keep a texel from stopping early.
  SceneBuilder b(4);
  const std::uint32_t m = b.material(Rgb(0.5f));
  b.quad({-1, 0, -1}, {0, 0, 2}, {2, 0, 0}, m);
  b.quad({-1, 0, -1}, {0, 0.5f, 0}, {0, 0, 2}, m);
  b.quad({1, 0, -1}, {0, 0, 2}, {0, 0.5f, 0}, m);
  b.quad({-1, 0, -1}, {2, 0, 0}, {0, 0.5f, 0}, m);
  b.quad({-1, 0, 1}, {0, 0.5f, 0}, {2, 0, 0}, m);
  constexpr float h = 0.03f;
  b.quad({-1, 0.5f, -1}, {1 - h, 0, 0}, {0, 0, 2}, m);
  b.quad({h, 0.5f, -1}, {1 - h, 0, 0}, {0, 0, 2}, m);
  b.quad({-h, 0.5f, -1}, {2 * h, 0, 0}, {0, 0, 1 - h}, m);
  b.quad({-h, 0.5f, h}, {2 * h, 0, 0}, {0, 0, 1 - h}, m);
  const Openness open = bake(b.scene, 2, {.error = 0.001});
  EXPECT_LE(open.rmsError, 0.001);
  // The floor lies in the first cell of the map, 24 x 24 texels with a margin of a tenth. Its mean is the form factor from floor to hole:
  // by reciprocity the hole's area over the floor's, times that of a small face to the rectangle opposite.
  double sum = 0.0, texels = 0.0;
  for (std::size_t y = 3; y < 21; ++y)
    for (std::size_t x = 3; x < 21; ++x) {
      sum += double(open.cosine[y * 96 + x]);
      texels += 1.0;
    }
  // Seen: 18 texels of 19.2 along each side.
  const double side = 18.0 / 19.2 / 0.5, root = std::sqrt(1.0 + side * side);
  const double expected = 0.0036 / (4.0 * (18.0 / 19.2) * (18.0 / 19.2)) * 4.0 * (2.0 * side / root * std::atan(side / root)) / (2.0 * kPi);
  EXPECT_NEAR(sum / texels, expected, 4.0 * open.rmsError / std::sqrt(texels));
}

}  // namespace
}  // namespace lmc::ao
