#include "libscene/texels.h"

#include <gtest/gtest.h>

#include <cmath>

#include "libscene/error.h"
#include "libscene/rng.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

using test::SceneBuilder;

/// One quad whose chart is this rectangle of the map, in texels of a map of `side`.
Scene chartAt(glm::vec2 lo, glm::vec2 hi, int side) {
  SceneBuilder b;
  b.quad({0, 0, 0}, {2, 0, 0}, {0, 0, -3}, b.material(Rgb(0.5f)));
  const glm::vec2 uv[4] = {lo, {hi.x, lo.y}, {lo.x, hi.y}, hi};  // SceneBuilder's order of vertices
  for (int i = 0; i < 4; ++i) b.scene.mapUv[std::size_t(i)] = uv[i] / float(side);
  return b.scene;
}

TEST(Texels, CoverageIsExact) {
  const int side = 100;  // not a multiple of the tile
  const Scene scene = chartAt({10.25f, 20.5f}, {80.75f, 90.125f}, side);
  const Charts charts = findCharts(scene, side, {});
  EXPECT_EQ(charts.count, 1u);
  const TexelMap map(scene, charts, side);
  double covered = 0.0;
  for (std::size_t t = 0; t < map.tileCount(); ++t) {
    const TexelTile tile = map.texels(t);
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        const int X = tile.x0 + x, Y = tile.y0 + y;
        const double w = std::max(0.0, std::min(80.75, X + 1.0) - std::max(10.25, double(X))),
                     h = std::max(0.0, std::min(90.125, Y + 1.0) - std::max(20.5, double(Y)));
        EXPECT_NEAR(tile.at(x, y).coverage, w * h, 1e-5) << X << ", " << Y;
        covered += tile.at(x, y).coverage;
      }
  }
  EXPECT_NEAR(covered, 70.5 * 69.625, 1e-2);
}

TEST(Texels, TheMiddleOfACutTexelIsThatOfItsCoveredPart) {
  const Scene scene = chartAt({1, 1}, {5.5f, 5.25f}, 8);
  const Charts charts = findCharts(scene, 8, {});
  const TexelTile tile = TexelMap(scene, charts, 8).texels(0);
  const auto middle = [&](int x, int y) { return TexelSampler(scene, tile, tile.at(x, y)).middle().position_m; };
  // 2 m along u, -3 m along v.
  const auto expected = [](double u, double v) { return glm::dvec3(2.0 * (u - 1.0) / 4.5, 0.0, -3.0 * (v - 1.0) / 4.25); };
  EXPECT_LT(glm::distance(middle(2, 3), expected(2.5, 3.5)), 1e-6);
  EXPECT_LT(glm::distance(middle(5, 3), expected(5.25, 3.5)), 1e-6);
  EXPECT_LT(glm::distance(middle(5, 5), expected(5.25, 5.125)), 1e-6);
}

TEST(Texels, SamplesStayInTheCoveredPartAndFillItEvenly) {
  const int side = 8;
  const Scene scene = chartAt({2.0f, 2.0f}, {5.5f, 5.25f}, side);
  const Charts charts = findCharts(scene, side, {});
  const TexelMap map(scene, charts, side);
  const TexelTile tile = map.texels(0);
  for (const auto& [x, y] : {std::pair(3, 3), std::pair(5, 3), std::pair(5, 5)}) {
    const Texel& t = tile.at(x, y);
    ASSERT_GT(t.fragmentCount, 0u);
    const Sobol4 numbers(77);
    const TexelSampler sampler(scene, tile, t);
    glm::dvec3 mean(0.0);
    constexpr int n = 4096;
    for (std::uint32_t k = 0; k < n; ++k) {
      const SurfacePoint p = sampler.at(numbers.point2(k));
      // Back to the map: the quad is 2 x 3 m over 3.5 x 3.25 texels.
      const double u = 2.0 + p.position_m.x / 2.0 * 3.5, v = 2.0 + -p.position_m.z / 3.0 * 3.25;
      EXPECT_GE(u, x - 1e-6);
      EXPECT_LE(u, std::min(x + 1.0, 5.5) + 1e-6);
      EXPECT_GE(v, y - 1e-6);
      EXPECT_LE(v, std::min(y + 1.0, 5.25) + 1e-6);
      mean += glm::dvec3(u, v, 0.0) / double(n);
      EXPECT_NEAR(p.geometricNormal.y, 1.0, 1e-12);
    }
    EXPECT_NEAR(mean.x, 0.5 * (x + std::min(x + 1.0, 5.5)), 2e-3);
    EXPECT_NEAR(mean.y, 0.5 * (y + std::min(y + 1.0, 5.25)), 2e-3);
  }
}

TEST(Texels, BlocksOfAChartAreNumberedAsRowsMeetThem) {
  constexpr std::uint32_t o = kNone;
  const std::vector<std::uint32_t> chart{0, 0, 0, o, 1, 1,  //
                                         0, o, 0, o, 0, 1,  //
                                         1, 1, o, o, o, o,  //
                                         1, 0, o, o, o, 0};
  std::vector<std::uint32_t> block(chart.size());
  EXPECT_EQ(numberChartBlocks(chart, 6, 2, block), 7u);
  EXPECT_EQ(block, (std::vector<std::uint32_t>{0, 0, 1, o, 2, 2,  //
                                               0, o, 1, o, 3, 2,  //
                                               4, 4, o, o, o, o,  //
                                               4, 5, o, o, o, 6}));
}

TEST(Texels, ApronKnowsTheNeighbourTile) {
  const int side = 128;
  const Scene scene = chartAt({0.0f, 0.0f}, {128.0f, 128.0f}, side);
  const Charts charts = findCharts(scene, side, {});
  const TexelMap map(scene, charts, side);
  const TexelTile tile = map.texels(0);
  EXPECT_NEAR(tile.at(64, 10).coverage, 1.0, 1e-6);
  EXPECT_EQ(tile.at(-1, 10).coverage, 0.0f) << "outside the map";
}

TEST(Texels, TheChartThatCoversMoreHasTheTexel) {
  SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.quad({0, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  b.quad({5, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  const glm::vec2 left[4] = {{1, 1}, {3.3f, 1}, {1, 3}, {3.3f, 3}}, right[4] = {{3.4f, 1}, {6, 1}, {3.4f, 3}, {6, 3}};
  for (std::size_t i = 0; i < 4; ++i) {
    b.scene.mapUv[i] = left[i] / 8.0f;
    b.scene.mapUv[4 + i] = right[i] / 8.0f;
  }
  const Charts charts = findCharts(b.scene, 8, {});
  EXPECT_EQ(charts.count, 2u);
  const TexelTile tile = TexelMap(b.scene, charts, 8).texels(0);
  EXPECT_EQ(tile.at(3, 1).chart, charts.chartOf[2]);
  EXPECT_NEAR(tile.at(3, 1).coverage, 0.6, 1e-5);
}

TEST(Charts, OverlapIsFoundAndNamed) {
  SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.quad({0, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  b.quad({5, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  for (std::size_t i = 0; i < 4; ++i) b.scene.mapUv[4 + i] = b.scene.mapUv[i] + 0.1f;
  try {
    findCharts(b.scene, 64, {});
    FAIL() << "not found";
  } catch (const Error& e) {
    EXPECT_EQ(e.kind, Exit::Broken);
    EXPECT_EQ(e.code, "LMC_UV_OVERLAP");
    EXPECT_EQ(e.where, "/meshes/0/primitives/0/attributes/TEXCOORD_1");
    EXPECT_NE(e.text.find("mesh 1"), std::string::npos);
  }
}

TEST(Charts, TouchingIsNoOverlap) {
  SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.quad({0, 0, 0}, {1, 0, 0}, {0, 0, -1}, m, 7);  // 98 triangles that share edges
  b.quad({5, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  for (std::size_t i = 0; i < b.scene.mapUv.size(); ++i) {
    // The charts share the line u = 0.7, which no float power of two is on.
    const glm::vec2 inCell = b.scene.uv0[i];
    b.scene.mapUv[i] = i < 64 ? inCell * glm::vec2(0.7f, 0.9f) : glm::vec2(0.7f + 0.3f * inCell.x, inCell.y);
  }
  EXPECT_EQ(findCharts(b.scene, 4096, {}).count, 2u);
}

TEST(Charts, MissingAndOutsideUvsAreRefused) {
  Scene scene = chartAt({1, 1}, {3, 3}, 8);
  scene.mapUv[3].x = 1.2f;
  EXPECT_THROW(findCharts(scene, 8, {}), Error);
  scene.mapUv[3].x = 1.0f + 1e-6f;  // rounding of an exporter
  EXPECT_NO_THROW(findCharts(scene, 8, {}));
  scene.objects[0].inMap = false;
  try {
    findCharts(scene, 8, {});
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.kind, Exit::Unsupported);
  }
  scene.objects[0].receive = false;
  EXPECT_EQ(findCharts(scene, 8, {}).count, 0u);
}

TEST(Charts, MirroredChartsKeepTheFront) {
  Scene scene = chartAt({6, 1}, {2, 5}, 8);  // u runs backwards
  const Charts charts = findCharts(scene, 8, {});
  const TexelTile tile = TexelMap(scene, charts, 8).texels(0);
  const SurfacePoint p = TexelSampler(scene, tile, tile.at(5, 1)).at({0.5f, 0.5f});
  EXPECT_NEAR(p.position_m.x, 0.25, 1e-6);  // texel 5.5 is 1/8 of the way from 6 to 2, of 2 m
  EXPECT_NEAR(p.geometricNormal.y, 1.0, 1e-12);
}

TEST(MapSide, FollowsTheDensity) {
  const Scene scene = chartAt({0, 0}, {64, 64}, 128);  // 6 m^2 on a quarter of the map
  EXPECT_EQ(mapSide(scene, 96, 16.0), 96);
  EXPECT_EQ(mapSide(scene, 0, 16.0), 128);  // 16 sqrt(6 / 0.25) = 78.4, next power of two
}

}  // namespace
}  // namespace lmc
