/// Cells of a map: what is gathered, what lies between, and where they are cut.
#include "libradiosity/map_cells.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>

#include "libradiosity/light_map.h"
#include "libscene/constants.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

struct Map {
  Map(Scene s, int side, bool interpolate = true)
      : scene(std::move(s)),
        charts(findCharts(scene, side, run)),
        texels(scene, charts, side),
        tracer(scene),
        map(startMap(scene, texels, run)),
        cells({side, side, map.chart.data()}, scene, texels, tracer, interpolate, run) {}
  std::size_t gathered() const {
    std::size_t n = 0;
    for (std::size_t i = 0; i < map.size(); ++i) n += cells.gathered(i);
    return n;
  }
  int x(std::size_t i) const { return int(i % std::size_t(map.width)); }
  int y(std::size_t i) const { return int(i / std::size_t(map.width)); }
  /// Cells are halved for light f(x, y), known without noise, until nothing changes; how often that took.
  int refine(const std::function<double(int, int)>& f, double error, double steep = 0.35) {
    for (int round = 0;; ++round)
      if (cells.refine(
              [&](std::size_t i) {
                return MapCells::Value{glm::dvec3(f(x(i), y(i))), 0.0};
              },
              [&](std::size_t) {
                return MapCells::Tolerance{error, 3.0, steep};
              }) == 0)
        return round;
  }
  /// f(texel, difference from what its corners foretell)
  void forOff(const std::function<double(int, int)>& light, const std::function<void(std::size_t, double)>& f) const {
    cells.forInterpolated([&](std::size_t i, const MapCells::Corners& c, const MapCells::Weights& w) {
      double sum = 0.0;
      for (std::size_t k = 0; k < 4; ++k) sum += w[k] * light(x(c[k]), y(c[k]));
      f(i, sum - light(x(i), y(i)));
    });
  }
  lmc::Run run;
  Scene scene;
  Charts charts;
  TexelMap texels;
  Tracer tracer;
  LightMap map;
  MapCells cells;
};

/// A room, a sheet that bends, and a triangle.
Scene ofAllShapes() {
  test::SceneBuilder s;
  const auto white = s.material(Rgb(0.5f));
  s.room({0, 0, 0}, {4, 3, 5}, {white, white, white, white, white, white});
  const std::uint32_t sheet = s.quad({1, 1, 1}, {2, 0, 0}, {0, 0, -1}, white, 16);
  const std::uint32_t first = s.scene.triangles[s.scene.objects[sheet].firstTriangle].x;
  for (std::uint32_t v = first; v < s.scene.positions_m.size(); ++v) {
    glm::vec3& p = s.scene.positions_m[v];
    const float a = 1.5f * (p.x - 2.0f);
    p = {2.0f + std::sin(a) / 1.5f, p.y + std::cos(a) / 1.5f, p.z};
    s.scene.normals[v] = {std::sin(a), std::cos(a), 0.0f};
  }
  s.quad({0.5f, 0.5f, 3}, {1, 0, 0}, {0, 1, 0}, white);
  s.scene.triangles.pop_back();
  s.scene.triangleObject.pop_back();
  --s.scene.objects.back().triangleCount;
  return s.scene;
}

void everyTexelHasAValue(const Map& m) {
  std::vector<int> seen(m.map.size(), 0);
  for (std::size_t i = 0; i < m.map.size(); ++i) {
    seen[i] = m.cells.gathered(i);
    EXPECT_TRUE(!seen[i] || m.map.chart[i] != kNone) << i;
  }
  m.cells.forInterpolated([&](std::size_t i, const MapCells::Corners& corners, const MapCells::Weights& weights) {
    ++seen[i];
    double sum = 0.0;
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_GE(weights[k], 0.0);
      EXPECT_TRUE(m.cells.gathered(corners[k])) << i;
      EXPECT_EQ(m.map.chart[corners[k]], m.map.chart[i]) << i;
      sum += weights[k];
    }
    EXPECT_NEAR(sum, 1.0, 1e-12);
  });
  for (std::size_t i = 0; i < m.map.size(); ++i) EXPECT_EQ(seen[i], m.map.chart[i] != kNone) << "texel " << i;
}

TEST(MapCells, EveryCoveredTexelIsGatheredOrInterpolatedOnItsChart) {
  Map m(ofAllShapes(), 128);
  everyTexelHasAValue(m);
  const std::size_t before = m.gathered();
  m.refine([](int x, int y) { return std::sin(0.3 * x) * std::cos(0.2 * y); }, 0.02);
  EXPECT_GT(m.gathered(), before);
  everyTexelHasAValue(m);
}

TEST(MapCells, WithoutInterpolationEveryTexelIsGathered) {
  const Map m(ofAllShapes(), 64, false);
  everyTexelHasAValue(m);
  m.cells.forInterpolated([](std::size_t i, const MapCells::Corners&, const MapCells::Weights&) { ADD_FAILURE() << i; });
}

TEST(MapCells, LinearLightIsReproducedAndCutsNothing) {
  Map m(ofAllShapes(), 128);
  const auto light = [](int x, int y) { return 3.0 + 0.25 * x - 0.125 * y; };
  m.refine(light, 1e-6);  // bends that no halving has shown yet
  const std::size_t before = m.gathered();
  EXPECT_EQ(m.refine(light, 1e-9), 0);
  EXPECT_EQ(m.gathered(), before);
  EXPECT_LT(double(before), 0.35 * double(std::ranges::count_if(m.map.chart, [](std::uint32_t c) { return c != kNone; })));
  m.forOff(light, [](std::size_t i, double off) { EXPECT_NEAR(off, 0.0, 1e-11) << i; });
  double errors = 0.0;
  m.cells.forErrors(
      [&](std::size_t i) {
        return MapCells::Value{glm::dvec3(light(m.x(i), m.y(i))), 0.0};
      },
      [&](std::size_t, double last, double before_) { errors += std::abs(last) + std::abs(before_); });
  EXPECT_NEAR(errors, 0.0, 1e-15);
}

TEST(MapCells, AStepIsCutDownToTheTexelsBesideIt) {
  for (const bool alongX : {true, false})
    for (const int at : {30, 41, 52}) {
      test::SceneBuilder s(1);
      s.quad({0, 0, 4}, {4, 0, 0}, {0, 0, -4}, s.material(Rgb(0.5f)));
      Map m(s.scene, 80);
      const auto light = [&](int x, int y) { return (alongX ? x : y) >= at ? 1.0 : 0.0; };
      m.refine(light, 1e-3);
      m.forOff(light, [&](std::size_t i, double off) { EXPECT_NEAR(off, 0.0, 1e-12) << m.x(i) << " " << m.y(i); });
      EXPECT_LT(m.gathered(), m.map.size() / 4) << "elsewhere it stays as it was";
    }
}

TEST(MapCells, AnEdgeInAnyTexelIsCutDownToThatTexel) {
  // The texel that holds the edge is half lit. In the very middle of a cell that looks straight at the first halving.
  for (const bool alongX : {true, false})
    for (int at = 9; at < 71; ++at) {
      test::SceneBuilder s(1);
      s.quad({0, 0, 4}, {4, 0, 0}, {0, 0, -4}, s.material(Rgb(0.5f)));
      Map m(s.scene, 80);
      const auto light = [&](int x, int y) {
        const int along = alongX ? x : y;
        return along < at ? 1.0 : along == at ? 0.5 : 0.0;
      };
      m.refine(light, 1e-3);
      m.forOff(light, [&](std::size_t i, double off) { EXPECT_NEAR(off, 0.0, 1e-12) << at << ": " << m.x(i) << " " << m.y(i); });
    }
}

TEST(MapCells, NoiseCutsNothing) {
  // Values that waver by their stated variance: a bend is one only above three times the noise's part.
  test::SceneBuilder s(1);
  s.quad({0, 0, 4}, {4, 0, 0}, {0, 0, -4}, s.material(Rgb(0.5f)));
  Map m(s.scene, 160);
  const std::size_t before = m.gathered();
  m.cells.refine(
      [](std::size_t i) {
        // Uniform of variance 1/12, the same for the three channels.
        return MapCells::Value{glm::dvec3(double(mix64(i * 0x9e3779b97f4a7c15ull) >> 11) * 0x1p-53), 1.0 / 12.0};
      },
      [](std::size_t) {
        return MapCells::Tolerance{1e-3, 3.0};
      });
  // Two lines a halving, 2 degrees of freedom: the share above 3 times the mean is exp(-3) = 5 % of each of four tests.
  EXPECT_LT(double(m.gathered()), 1.3 * double(before));
}

TEST(MapCells, ARiseThatLooksStraightAtOneHalvingIsCutAgainWhereItIsSteep) {
  // Cells of 16 texels, from 23 and from 39, of a floor; light goes by 3 over each, so that halves of cells change by a sixth to a fifth,
  // and waves by 0.4 with their length: ends and middle lie on a line.
  test::SceneBuilder s(1);
  s.quad({0, 0, 4}, {4, 0, 0}, {0, 0, -4}, s.material(Rgb(0.5f)));
  for (glm::vec2& uv : s.scene.mapUv) uv = glm::vec2(uv.x < 0.5f ? 0.125f : 0.875f, uv.y < 0.5f ? 0.125f : 0.875f);
  const std::function<double(int, int)> light = [](int x, int) {
    return 9.0 - 3.0 * std::abs(x - 39) / 16.0 + 0.4 * std::sin(2.0 * kPi * (x - 23) / 16.0);
  };
  const auto worst = [&](double steep) {
    Map m(s.scene, 64);
    m.refine(light, 1e-3, steep);
    double out = 0.0;
    m.forOff(light, [&](std::size_t, double off) { out = std::max(out, std::abs(off)); });
    return out;
  };
  // Between neighbours but one: (2 pi / 16)^2 / 2 of the wave.
  EXPECT_LT(worst(0.15), 0.08 * 0.4);
  EXPECT_GT(worst(0.3), 0.3) << "the wave is not one that hides";
}

TEST(MapCells, WhatStandsBetweenCornersIsFound) {
  // A board upright on the floor, wherever it stands in a texel: no texel may be interpolated from both of its sides, nor from a texel that
  // has light of both. Texel (x, y) of 64 of 80: x along +x, y along -z.
  const double texel_m = 1.0 / 16.0;
  for (int at = 9; at < 70; ++at)
    for (const double within : {0.0, -0.4, 0.4}) {
      const double z = 4.0 - (at + 0.5 - 8.0 + within) * texel_m;
      test::SceneBuilder s(1);
      const auto white = s.material(Rgb(0.5f));
      s.quad({0, 0, 4}, {4, 0, 0}, {0, 0, -4}, white);
      s.quad({0.8f, 0, float(z)}, {2.5f, 0, 0}, {0, 1, 0}, white);
      s.scene.objects[1].receive = false;
      s.scene.objects[1].inMap = false;
      const Map m(s.scene, 80);
      const auto zOf = [&](std::size_t i) { return 4.0 - (m.y(i) + 0.5 - 8.0) * texel_m; };
      const auto xOf = [&](std::size_t i) { return (m.x(i) + 0.5 - 8.0) * texel_m; };
      m.cells.forInterpolated([&](std::size_t i, const MapCells::Corners& corners, const MapCells::Weights& weights) {
        if (xOf(i) < 0.8 || xOf(i) > 3.3) return;
        for (std::size_t k = 0; k < 4; ++k)
          if (weights[k] > 0.0) {
            EXPECT_EQ(zOf(corners[k]) > z, zOf(i) > z) << m.x(i) << " " << m.y(i) << ", board at " << z;
            EXPECT_GT(std::abs(zOf(corners[k]) - z), 0.5 * texel_m) << m.x(i) << " " << m.y(i) << ", board at " << z;
          }
      });
    }
}

TEST(MapCells, ASampleStandsForTheWholeMap) {
  Map m(ofAllShapes(), 512);
  std::vector<std::uint8_t> whole(m.map.size());
  double count = 0.0, sum = 0.0;
  const auto value = [&](std::size_t i) { return 2.0 + std::sin(0.02 * m.x(i)) * std::cos(0.03 * m.y(i)); };
  for (std::size_t i = 0; i < whole.size(); ++i) {
    if (!m.cells.gathered(i)) continue;
    whole[i] = 1;
    count += 1.0;
    sum += value(i);
  }
  const std::vector<MapCells::Block> blocks = m.cells.blocks(3);
  std::vector<double> sizes;
  for (const MapCells::Block& b : blocks) {
    EXPECT_FALSE(b.probes.empty());
    for (const std::size_t i : b.probes) EXPECT_TRUE(m.cells.gathered(i));
    sizes.push_back(b.points * value(b.probes[0]));
  }
  std::vector<std::uint32_t> chart(m.map.chart.begin(), m.map.chart.end());
  m.cells.sample(blocks, sizes, 0.2 * double(blocks.size()), chart);
  double standsFor = 0.0;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    EXPECT_TRUE(chart[i] == kNone || chart[i] == m.map.chart[i]) << i;
    if (!m.cells.gathered(i)) continue;
    EXPECT_TRUE(whole[i] && chart[i] != kNone) << i;
    standsFor += m.cells.standsFor(i);
  }
  EXPECT_LT(double(m.gathered()), 0.5 * count);
  // Points are known by number, so that their estimate is no estimate; another sum is met as the blocks differ. Weights are floats.
  EXPECT_NEAR(standsFor, count, 1e-5 * count);
  EXPECT_NEAR(m.cells.estimate([](std::size_t) { return 1.0; }).sum, count, 1e-9 * count);
  const MapCells::Estimate e = m.cells.estimate(value);
  EXPECT_GT(e.standardError, 0.0);
  EXPECT_NEAR(e.sum, sum, 4.0 * e.standardError);
}

TEST(MapCells, ASampleOfAllBlocksIsTheMap) {
  Map m(ofAllShapes(), 512);
  std::vector<std::uint8_t> whole(m.map.size());
  for (std::size_t i = 0; i < whole.size(); ++i) whole[i] = m.cells.gathered(i);
  const std::vector<MapCells::Block> blocks = m.cells.blocks(3);
  std::vector<std::uint32_t> chart(m.map.chart.begin(), m.map.chart.end());
  std::vector<double> sizes(blocks.size(), 1.0);
  sizes[0] = 7.0;
  m.cells.sample(blocks, sizes, 2.0 * double(blocks.size()), chart);
  for (std::size_t i = 0; i < whole.size(); ++i) {
    EXPECT_EQ(chart[i], m.map.chart[i]) << i;
    EXPECT_EQ(m.cells.gathered(i), whole[i] != 0) << i;
    // Cells share their edges: a point there that counted for one of them alone would leave half of it out.
    if (!whole[i]) continue;
    EXPECT_NEAR(m.cells.standsFor(i), 1.0, 1e-6) << i;
  }
}

TEST(MapCells, RectangularChartsStartWithoutLooseBorders) {
  // A chart of w x h texels is cut evenly into ceil((w - 1)/16) x ceil((h - 1)/16) cells, each halved once along both axes.
  for (const int side : {16, 32, 64, 96, 160}) {
    test::SceneBuilder s(1);
    s.quad({0, 0, 4}, {4, 0, 0}, {0, 0, -4}, s.material(Rgb(0.5f)));
    // Borders that are borders of texels, without a rounding that touches one more row.
    for (glm::vec2& uv : s.scene.mapUv) uv = glm::vec2(uv.x < 0.5f ? 0.125f : 0.875f, uv.y < 0.5f ? 0.125f : 0.875f);
    const Map m(s.scene, side);
    int x0 = side, x1 = 0, y0 = side, y1 = 0;
    for (std::size_t i = 0; i < m.map.size(); ++i)
      if (m.map.chart[i] != kNone)
        x0 = std::min(x0, m.x(i)), x1 = std::max(x1, m.x(i)), y0 = std::min(y0, m.y(i)), y1 = std::max(y1, m.y(i));
    const auto lines = [](int extent) { return std::size_t(2 * ((extent + MapCells::kWidest - 1) / MapCells::kWidest) + 1); };
    ASSERT_EQ(x1 - x0 + 1, 3 * side / 4);
    EXPECT_EQ(m.gathered(), lines(x1 - x0) * lines(y1 - y0)) << side;
  }
}

}  // namespace
}  // namespace lmc
