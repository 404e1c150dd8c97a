/// What a sample of a map's cells foretells of its hemisphere rays.
#include <gtest/gtest.h>

#include <algorithm>

#include "libradiosity/light_map.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

struct Told {
  HemisphereForecast forecast;
  double came = 0.0;
};

/// Sky rays of a map: foretold from a share of its cells, and cast.
Told rays(const Scene& scene, int side, double share, std::uint64_t seed) {
  Run run;
  run.seed = seed;
  const Charts charts = findCharts(scene, side, run);
  const TexelMap texels(scene, charts, side);
  const Tracer tracer(scene);
  const DirectLight direct(scene, tracer, true);
  const Gather gather(scene, tracer, direct, nullptr, false, run.seed);
  LightMap map = startMap(scene, texels, run);
  for (auto& half : map.direct) half.assign(map.size(), Rgb(0.0f));
  MapOptions options;
  Told out;
  LightMap sample = map;
  options.sampled = share;
  out.forecast = foretellHemisphere(
      sample, scene, texels, tracer, gather, options, [] {}, run);
  options.sampled = 1.0;
  bakeHemisphere(map, scene, texels, tracer, gather, options, run);
  for (const std::uint32_t n : map.rays) out.came += 2.0 * n;
  return out;
}

TEST(Foretell, AFewTexelsOfADarkObjectDoNotSpeakForAllOfIt) {
  // Boards close above the ground, each less than a hundredth of the map: too little for a limit of its own. Every fourth looks down and is
  // nearly dark, where that would ask for many rays.
  test::SceneBuilder s(14);
  const auto grey = s.material(Rgb(0.5f));
  s.quad({-20, 0, 20}, {40, 0, 0}, {0, 0, -40}, grey);
  for (int i = 0; i < 12; ++i)
    for (int j = 0; j < 12; ++j) {
      const glm::vec3 x(1.5f, 0, 0), z(0, 0, 1.5f);
      const bool down = (i + j) % 4 == 0;
      s.quad({3.0f * float(i) - 18, 0.4f, 3.0f * float(j) - 18}, down ? x : z, down ? z : x, grey);
    }
  s.scene.sky = Rgb(1.0f);
  // Few of the dark boards are in a sample, and one tells as many rays as another does not: right in the mean, and by a factor of two and a
  // half in a single forecast. What each board asked for by itself was eight times too much.
  std::vector<double> ratios;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Told told = rays(s.scene, 512, 0.08, seed);
    ratios.push_back(told.forecast.rays / told.came);
    EXPECT_GT(told.forecast.standardError, 0.15 * told.forecast.rays);
  }
  std::ranges::sort(ratios);
  EXPECT_GT(ratios[2], 0.6);
  EXPECT_LT(ratios[2], 1.6);
}

}  // namespace
}  // namespace lmc
