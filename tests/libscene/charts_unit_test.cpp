#include "libscene/charts.h"

#include <gtest/gtest.h>

#include <cmath>

#include "libscene/error.h"
#include "libscene/polygon2.h"
#include "libscene/rng.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

constexpr int kSide = 256;

using Corners = std::array<glm::vec2, 3>;

/// Triangles of all sizes anywhere in a map, as many as would not all be told if they overlapped.
std::vector<Corners> scattered(std::uint64_t seed, int count) {
  const Sobol4 numbers(seed);
  std::vector<Corners> out;
  std::uint32_t next = 0;
  for (int i = 0; i < count; ++i) {
    // Sizes from a hundredth of the map to half of it, few of them large.
    const glm::vec2 u = numbers.point2(next++);
    const float size = 0.01f * std::pow(50.0f, u.x * u.x * u.x);
    const glm::vec2 corner = (1.0f - size) * numbers.point2(next++);
    Corners c;
    for (glm::vec2& p : c) p = corner + size * numbers.point2(next++);
    out.push_back(c);
  }
  return out;
}

/// One object of them.
Scene sceneOf(const std::vector<Corners>& uvs) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  std::vector<glm::vec3> positions, normals;
  std::vector<glm::vec2> mapUv;
  std::vector<glm::uvec3> triangles;
  for (const Corners& c : uvs) {
    const auto first = std::uint32_t(positions.size());
    for (const glm::vec2& p : c) {
      positions.emplace_back(p.x, 0.0f, p.y);
      normals.emplace_back(0.0f, 1.0f, 0.0f);
      mapUv.push_back(p);
    }
    triangles.emplace_back(first, first + 1, first + 2);
  }
  b.mesh(positions, normals, mapUv, triangles, m);
  return b.scene;
}

double sharedArea(Corners a, Corners b) {
  const auto cross = [](const Corners& c) { return Polygon2::cross(glm::dvec2(c[1] - c[0]), glm::dvec2(c[2] - c[0])); };
  for (Corners* c : {&a, &b})
    if (cross(*c) < 0.0) std::swap((*c)[1], (*c)[2]);
  Polygon2 p({glm::dvec2(a[0]), glm::dvec2(a[1]), glm::dvec2(a[2])});
  for (int e = 0; e < 3; ++e)
    p.clip(glm::dvec2(b[std::size_t(e)]), glm::dvec2(b[std::size_t((e + 1) % 3)]) - glm::dvec2(b[std::size_t(e)]));
  return p.area();
}

struct Pairs {
  std::size_t sure = 0, any = 0;  ///< that overlap by much more than is harmless; by anything at all
  std::uint32_t first = kNone;    ///< the lower triangle of the first sure one
};

Pairs pairsOf(const std::vector<Corners>& uvs) {
  Pairs out;
  for (std::uint32_t a = 0; a < uvs.size(); ++a)
    for (std::uint32_t b = a + 1; b < uvs.size(); ++b) {
      const double texels = sharedArea(uvs[a], uvs[b]) * kSide * kSide;
      out.any += texels > 0.0;
      // 1/32 of a texel for each texel of length, and a map is 256 long.
      if (texels <= 2.0 * kSide / 32.0 * std::sqrt(2.0)) continue;
      ++out.sure;
      if (out.first == kNone) out.first = a;
    }
  return out;
}

TEST(Charts, PairsOfOverlappingTrianglesAreAllFoundAndOnce) {
  for (const std::uint64_t seed : {1u, 2u, 3u, 4u}) {
    const std::vector<Corners> uvs = scattered(seed, 160);
    const Pairs pairs = pairsOf(uvs);
    ASSERT_GT(pairs.sure, 20u);
    ASSERT_LT(pairs.any, 1000u) << "more are not counted";
    const std::vector<UvFault> faults = uvFaults(sceneOf(uvs), kSide);
    ASSERT_EQ(faults.size(), 1u);
    EXPECT_EQ(faults[0].kind, UvFault::Kind::Overlap);
    const std::size_t at = faults[0].text.find("; ");
    ASSERT_NE(at, std::string::npos) << faults[0].text;
    const auto told = std::stoul(faults[0].text.substr(at + 2));
    EXPECT_GE(told, pairs.sure) << faults[0].text;
    EXPECT_LE(told, pairs.any) << faults[0].text;
  }
}

TEST(Charts, OneOverlapAmongManyTrianglesIsFoundWhereverItLies) {
  // A grid without overlaps, and one triangle more on any of its cells: near the lines at which boxes are parted, too.
  constexpr int kCells = 40;
  std::vector<Corners> grid;
  for (int y = 0; y < kCells; ++y)
    for (int x = 0; x < kCells; ++x) {
      const glm::vec2 p{float(x), float(y)}, s{1.0f / kCells, 1.0f / kCells};
      grid.push_back({s * p, s * (p + glm::vec2(1, 0)), s * (p + glm::vec2(1, 1))});
      grid.push_back({s * p, s * (p + glm::vec2(1, 1)), s * (p + glm::vec2(0, 1))});
    }
  EXPECT_TRUE(uvFaults(sceneOf(grid), kSide).empty());
  for (std::size_t k = 0; k < grid.size(); k += 37) {
    std::vector<Corners> more = grid;
    const glm::vec2 middle = (grid[k][0] + grid[k][1] + grid[k][2]) / 3.0f;
    more.push_back({glm::mix(middle, grid[k][0], 0.9f), glm::mix(middle, grid[k][1], 0.9f), glm::mix(middle, grid[k][2], 0.9f)});
    const std::vector<UvFault> faults = uvFaults(sceneOf(more), kSide);
    ASSERT_EQ(faults.size(), 1u) << k;
    EXPECT_NE(faults[0].text.find("1 pairs of triangles overlap"), std::string::npos) << faults[0].text;
    EXPECT_NE(faults[0].text.find("triangle " + std::to_string(k) + " of"), std::string::npos) << faults[0].text;
  }
}

TEST(Charts, MapsDoNotMeet) {
  Scene scene = sceneOf(scattered(5, 40));
  const std::size_t vertices = scene.positions_m.size(), triangles = scene.triangles.size();
  ASSERT_EQ(uvFaults(scene, kSide).size(), 1u);
  // Each triangle as an object in a map of its own.
  Scene apart = scene;
  apart.objects.clear();
  for (std::uint32_t t = 0; t < triangles; ++t) {
    Object o = scene.objects[0];
    o.firstTriangle = t;
    o.triangleCount = 1;
    o.firstVertex = 3 * t;
    o.vertexCount = 3;
    o.map = std::uint32_t(triangles) - 1 - t;  // against the order of the triangles
    apart.triangleObject[t] = t;
    apart.objects.push_back(o);
  }
  ASSERT_EQ(vertices, 3 * triangles);
  EXPECT_TRUE(uvFaults(apart, kSide).empty());
  for (Object& o : apart.objects) o.map = 3;
  EXPECT_FALSE(uvFaults(apart, kSide).empty());
}

}  // namespace
}  // namespace lmc
