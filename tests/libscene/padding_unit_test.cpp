#include "libscene/padding.h"

#include <gtest/gtest.h>

#include <cmath>

#include "libscene/polygon2.h"
#include "libscene/rng.h"
#include "libscene/texels.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

constexpr int kSide = 64;

/// Triangles of their own charts all over a map, as many as do not overlap: gaps from none to a few texels.
Scene crowded(std::uint64_t seed) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  const Sobol4 numbers(seed);
  std::uint32_t next = 0;
  for (int cell = 0; cell < 144; ++cell) {
    // Three corners in a square of the map, 5.33 texels wide: triangles of neighbouring squares come as near as chance has it.
    const glm::vec2 origin(float(cell % 12) / 12.0f, float(cell / 12) / 12.0f);
    std::array<glm::vec2, 3> uv;
    for (auto& c : uv) c = origin + numbers.point2(next++) / 12.0f;
    const std::array<glm::vec3, 3> p{glm::vec3(cell, 0, 0), glm::vec3(cell, 0, 1), glm::vec3(cell + 0.5f, 0, 0)};
    const std::array<glm::vec3, 3> n{glm::vec3(0, 1, 0), glm::vec3(0, 1, 0), glm::vec3(0, 1, 0)};
    const std::array<glm::uvec3, 1> t{glm::uvec3(0, 1, 2)};
    b.mesh(p, n, uv, t, m);
  }
  return b.scene;
}

struct Padded {
  std::vector<std::uint32_t> chart;
  Charts charts;
  Padding padding;
  int height = 0;
};

Padded padded(const Scene& scene, int side, int maps = 1) {
  Padded out;
  out.charts = findCharts(scene, side, {});
  const TexelMap map(scene, out.charts, side, maps);
  out.height = map.height();
  out.chart.assign(std::size_t(side) * std::size_t(map.height()), kNone);
  for (std::size_t t = 0; t < map.tileCount(); ++t) {
    const TexelTile tile = map.texels(t);
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x)
        out.chart[std::size_t(tile.y0 + y) * std::size_t(side) + std::size_t(tile.x0 + x)] = tile.at(x, y).chart;
  }
  out.padding = makePadding(scene, out.charts, out.chart, side, {});
  return out;
}

/// Whether a bilinear lookup somewhere in the triangle reads the texel: some of it lies in the square of two texels about its centre.
bool reads(const Scene& scene, std::uint32_t triangle, int x, int y, int side) {
  const glm::uvec3 t = scene.triangles[triangle];
  const Object& o = scene.objectOf(triangle);
  Polygon2 p({scene.mapPlace(o, t.x, side), scene.mapPlace(o, t.y, side), scene.mapPlace(o, t.z, side)});
  if (p.area() < 0.0) p.assign({p.corners()[0], p.corners()[2], p.corners()[1]});
  p.clip({x - 0.5, 0.0}, {0.0, -1.0});
  p.clip({x + 1.5, 0.0}, {0.0, 1.0});
  p.clip({0.0, y - 0.5}, {1.0, 0.0});
  p.clip({0.0, y + 1.5}, {-1.0, 0.0});
  return p.corners().size() >= 3 && p.area() > 1e-12;
}

TEST(Padding, IsWhatSearchingEverywhereFinds) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const Scene scene = crowded(seed);
    const Padded got = padded(scene, kSide);
    std::vector<std::uint32_t> contested;
    std::uint64_t ring = 0;
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) {
        const std::uint32_t i = std::uint32_t(y * kSide + x);
        std::vector<std::uint32_t> readers;
        for (std::uint32_t t = 0; t < scene.triangles.size(); ++t)
          if (reads(scene, t, x, y, kSide)) readers.push_back(got.charts.chartOf[t]);
        if (got.chart[i] != kNone && std::ranges::find(readers, got.chart[i]) == readers.end()) readers.push_back(got.chart[i]);
        if (readers.size() > 1) contested.push_back(i);
        ring += got.chart[i] == kNone && !readers.empty();
        // The nearest of those that read it, or of all where none does or none of them has a texel.
        const auto nearest = [&](bool ofReaders) {
          std::uint32_t found = kNone;
          int best = kPadding * kPadding + 1;
          for (int v = 0; v < kSide; ++v)
            for (int u = 0; u < kSide; ++u) {
              const std::uint32_t k = std::uint32_t(v * kSide + u);
              const int d2 = (u - x) * (u - x) + (v - y) * (v - y);
              if (got.chart[k] == kNone || d2 >= best) continue;
              if (ofReaders && std::ranges::find(readers, got.chart[k]) == readers.end()) continue;
              best = d2;
              found = k;
            }
          return found;
        };
        std::uint32_t want = got.chart[i] != kNone ? i : nearest(true);
        if (want == kNone) want = nearest(false);
        ASSERT_EQ(got.padding.from[i], want) << "texel " << x << ", " << y << " of seed " << seed;
      }
    EXPECT_EQ(got.padding.contested, contested);
    EXPECT_GT(ring, 300u);
    EXPECT_GT(contested.size(), 10u) << "the layout is tight on purpose";
  }
}

TEST(Padding, ALooseLayoutHasNothingContestedAndEveryLookupStaysInItsChart) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.room({0, 0, 0}, {3, 2, 4}, {m, m, m, m, m, m});
  const Padded got = padded(b.scene, kSide);
  EXPECT_TRUE(got.padding.contested.empty());
  const Sobol4 numbers(5);
  for (std::uint32_t t = 0; t < b.scene.triangles.size(); ++t)
    for (std::uint32_t k = 0; k < 1000; ++k) {
      const glm::vec2 u = numbers.point2(k);
      const double s = std::sqrt(double(u.x));
      const glm::uvec3 v = b.scene.triangles[t];
      const Object& o = b.scene.objectOf(t);
      const glm::dvec2 a = b.scene.mapPlace(o, v.x, kSide), c = b.scene.mapPlace(o, v.y, kSide), d = b.scene.mapPlace(o, v.z, kSide);
      const glm::ivec2 f(glm::floor(a + s * (1.0 - double(u.y)) * (c - a) + s * double(u.y) * (d - a) - 0.5));
      for (const glm::ivec2 p : {f, f + glm::ivec2(1, 0), f + glm::ivec2(0, 1), f + glm::ivec2(1, 1)}) {
        const std::uint32_t from = got.padding.from[std::size_t(p.y * kSide + p.x)];
        ASSERT_NE(from, kNone);
        ASSERT_EQ(got.chart[from], got.charts.chartOf[t]) << "texel " << p.x << ", " << p.y;
      }
    }
}

TEST(Padding, StopsAtTheBorderOfAMap) {
  // The last rows of the first map and the first rows of the second are covered, in the left and the right half.
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.quad({0, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  b.quad({2, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  b.scene.objects[1].map = 1;
  const glm::vec2 first[4] = {{0, 0.75f}, {0.5f, 0.75f}, {0, 1}, {0.5f, 1}}, second[4] = {{0.5f, 0}, {1, 0}, {0.5f, 0.25f}, {1, 0.25f}};
  for (std::size_t i = 0; i < 4; ++i) {
    b.scene.mapUv[i] = first[i];
    b.scene.mapUv[4 + i] = second[i];
  }
  const Padded got = padded(b.scene, kSide, 2);
  EXPECT_EQ(got.height, 2 * kSide);
  std::uint64_t repeated = 0;
  for (std::uint32_t i = 0; i < got.padding.from.size(); ++i) {
    if (got.padding.from[i] == kNone) continue;
    repeated += got.padding.from[i] != i;
    EXPECT_EQ(got.padding.from[i] / (kSide * kSide), i / (kSide * kSide)) << "texel " << i;
  }
  EXPECT_GT(repeated, 2u * 4u * 32u);
  EXPECT_TRUE(got.padding.contested.empty());
}

}  // namespace
}  // namespace lmc
