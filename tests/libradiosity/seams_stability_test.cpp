/// Seams of a ball, a column and walls cut in two close; creases keep their bytes.
#include "libradiosity/seams.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstring>

#include "libscene/constants.h"
#include "libscene/parallel.h"
#include "tests/support/bake_scene.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

constexpr int kSide = 128;
constexpr double kGoal = 0.02;

/// A rectangle of the map, in shares of its side.
struct Cell {
  glm::vec2 lo, size;
};

using Surface = std::pair<glm::vec3, glm::vec3>;  // position and normal

/// A grid of n x m quads over u and v in [0, 1].
template <class At>
std::uint32_t grid(test::SceneBuilder& b, std::uint32_t material, int n, int m, Cell cell, At&& at) {
  std::vector<glm::vec3> positions, normals;
  std::vector<glm::vec2> uv;
  std::vector<glm::uvec3> triangles;
  for (int j = 0; j <= m; ++j)
    for (int i = 0; i <= n; ++i) {
      const auto [p, normal] = at(double(i) / n, double(j) / m);
      positions.push_back(p);
      normals.push_back(normal);
      uv.push_back(cell.lo + cell.size * glm::vec2(float(i) / float(n), float(j) / float(m)));
    }
  for (int j = 0; j < m; ++j)
    for (int i = 0; i < n; ++i) {
      const auto a = std::uint32_t(j * (n + 1) + i), c = a + std::uint32_t(n) + 1;
      triangles.emplace_back(a, a + 1, c + 1);
      triangles.emplace_back(a, c + 1, c);
    }
  return b.mesh(positions, normals, uv, triangles, material);
}

enum : std::uint32_t { kRoom = 0, kColumn = 6, kBall, kShelf = kBall + 6, kShelfFine, kBox };  // objects; a box has five sides
constexpr int kColumnRows = 6, kColumnSides = 16, kBallSides = 8;

/// A room with a column of one chart, whose cut is a seam of the chart with itself; a ball of six objects, one of them at half the
/// density; a shelf of two objects end to end in one plane, the second at twice the density; a box.
Scene level(float scale = 1.0f, glm::vec3 at = glm::vec3(0.0f)) {
  test::SceneBuilder b;
  const auto white = b.material(Rgb(0.7f)), red = b.material(Rgb(0.6f, 0.1f, 0.1f));
  const auto place = [&](glm::dvec3 p) { return at + scale * glm::vec3(p); };
  b.room(place({0, 0, 0}), place({4, 2.6, 3}), {white, red, white, white, white, white});
  const auto round = [&](double u) { return glm::dvec3(std::cos(2 * kPi * u), 0, -std::sin(2 * kPi * u)); };
  grid(b, white, kColumnSides, kColumnRows, {{0.02f, 0.52f}, {0.42f, 0.2f}}, [&](double u, double v) -> Surface {
    return {place(glm::dvec3(3, 0.05 + 1.8 * v, 1) + 0.3 * round(u)), glm::vec3(round(u))};
  });
  // The sides of a cube blown up to a ball; the last one has half the density.
  for (int k = 0; k < 6; ++k) {
    const double sign = k < 3 ? 1.0 : -1.0;
    glm::dvec3 w(0.0), s(0.0), t(0.0);
    w[k % 3] = sign;
    s[(k + 1) % 3] = 1.0;
    t[(k + 2) % 3] = sign;
    const Cell cell{{0.5f + 0.12f * float(k % 4), 0.52f + 0.12f * float(k / 4)}, glm::vec2(k == 5 ? 0.05f : 0.1f)};
    grid(b, white, kBallSides, kBallSides, cell, [&](double u, double v) -> Surface {
      const auto along = [](double share) { return std::tan(0.25 * kPi * (2.0 * share - 1.0)); };
      const glm::dvec3 n = glm::normalize(w + along(u) * s + along(v) * t);
      return {place(glm::dvec3(1.3, 1.1, 1.2) + 0.6 * n), glm::vec3(n)};
    });
  }
  const auto shelf = [&](double x0, double x1) {
    return [&, x0, x1](double u, double v) -> Surface { return {place({glm::mix(x0, x1, u), 0.4, 2.9 - 0.5 * v}), glm::vec3(0, 1, 0)}; };
  };
  grid(b, white, 2, 2, {{0.03f, 0.77f}, {0.1f, 0.08f}}, shelf(1.0, 1.8));
  grid(b, white, 2, 2, {{0.18f, 0.77f}, {0.2f, 0.16f}}, shelf(1.8, 2.6));
  // The box: its sides get cells of the map's last row.
  const glm::vec3 lo = place({2.2, 0.01, 1.6}), d = scale * glm::vec3(0.5f, 0.5f, 0.5f), X(d.x, 0, 0), Y(0, d.y, 0), Z(0, 0, d.z);
  const std::array<std::array<glm::vec3, 3>, 5> sides{{{lo, Z, Y}, {lo + X, Y, Z}, {lo + Y, Z, X}, {lo, Y, X}, {lo + Z, X, Y}}};
  for (int s = 0; s < 5; ++s) {
    const auto& [o, u, v] = sides[std::size_t(s)];
    const std::uint32_t object = b.quad(o, u, v, white);
    const std::uint32_t first = b.scene.objects[object].firstVertex;
    for (std::uint32_t k = 0; k < 4; ++k)
      b.scene.mapUv[first + k] = glm::vec2(0.42f + 0.115f * float(s), 0.86f) + 0.09f * glm::vec2(float(k & 1), float(k >> 1));
  }
  Light l;
  l.path = "/lamp";
  l.position_m = glm::dvec3(at) + double(scale) * glm::dvec3(1.9, 2.3, 2.0);
  l.intensity = Rgb(40.0f, 36.0f, 30.0f) * scale * scale;
  b.scene.lights.push_back(l);
  return b.scene;
}

/// A bake whose seams are open, and all that closing them takes.
struct Open {
  explicit Open(const Scene& s, float scale = 1.0f) : scene(s) {
    baked = test::bakeScene(scene, {.side = kSide, .goal = kGoal, .patchSize_m = 0.4 * double(scale), .solver = Solver::Stored});
    charts = findCharts(scene, kSide, {});
    padding = makePadding(scene, charts, baked.map.chart, kSide, {});
    seams = findSeams(scene);
    open = baked.values;
    fillPadding(open, padding);
  }
  SeamResult close(LightMapValues& values, int threads = 0) const {
    Run run;
    run.threads = threads;
    return closeSeams(values, baked.map, scene, charts, padding, seams, kGoal, run);
  }
  bool covered(std::size_t i) const { return baked.map.chart[i] != kNone; }

  Scene scene;
  test::Baked baked;
  Charts charts;
  Padding padding;
  Seams seams;
  LightMapValues open;
};

const Open& openLevel() {
  static const Open open(level());
  return open;
}

/// Bilinear, as a shader reads a map; of a vector of texels.
template <class Value>
glm::dvec3 lookup(glm::dvec2 place, Value&& value) {
  const glm::dvec2 p = place - 0.5, f = glm::floor(p), w = p - f;
  glm::dvec3 sum(0.0);
  for (int k = 0; k < 4; ++k) {
    const int x = std::clamp(int(f.x) + (k & 1), 0, kSide - 1), y = std::clamp(int(f.y) + (k >> 1), 0, kSide - 1);
    sum += (k & 1 ? w.x : 1.0 - w.x) * (k >> 1 ? w.y : 1.0 - w.y) * value(std::size_t(y) * kSide + std::size_t(x));
  }
  return sum;
}

struct Worst {
  double jump = 0.0, relative = 0.0, rms = 0.0;
  double errors = 0.0;  ///< largest jump in standard errors of the light there (one side)
};

/// At 64 places an edge, which the stage knows nothing of.
Worst worstOf(const Open& o, const LightMapValues& values, std::uint32_t firstObject, std::uint32_t lastObject) {
  Worst worst;
  double squares = 0.0, n = 0.0;
  for (const SharedEdge& e : o.seams.smooth) {
    const std::uint32_t object = o.scene.triangleObject[e.triangle[0]];
    if (object < firstObject || object > lastObject) continue;
    for (int k = 0; k < 64; ++k) {
      std::array<glm::dvec3, 2> E, error;
      for (std::size_t s = 0; s < 2; ++s) {
        const Object& of = o.scene.objectOf(e.triangle[s]);
        const glm::dvec2 at =
            glm::mix(o.scene.mapPlace(of, e.vertex[s].x, kSide), o.scene.mapPlace(of, e.vertex[s].y, kSide), (k + 0.5) / 64.0);
        E[s] = lookup(at, [&](std::size_t i) { return glm::dvec3(values.direct[i]) + glm::dvec3(values.indirect[i]); });
        error[s] = lookup(at, [&](std::size_t i) { return glm::dvec3(values.error[i]); });
      }
      const glm::dvec3 d = glm::abs(E[0] - E[1]), mean = 0.5 * (E[0] + E[1]), err = 0.5 * (error[0] + error[1]);
      worst.jump = std::max({worst.jump, d.x, d.y, d.z});
      for (int c = 0; c < 3; ++c) {
        worst.relative = std::max(worst.relative, d[c] / mean[c]);
        worst.errors = std::max(worst.errors, d[c] / err[c]);
        squares += d[c] * d[c] / (mean[c] * mean[c]);
        n += 1.0;
      }
    }
  }
  worst.rms = std::sqrt(squares / n);
  return worst;
}

TEST(Seams, AreFoundOnSmoothSurfacesWithinChartsAndBetweenObjects) {
  const Seams seams = findSeams(level());
  // The column's cut, the twelve edges of the ball's cube, the shelf's two quads.
  EXPECT_EQ(seams.smooth.size(), kColumnRows + 12 * kBallSides + 2u);
  std::uint64_t within = 0;
  for (const SharedEdge& e : seams.smooth) within += level().triangleObject[e.triangle[0]] == level().triangleObject[e.triangle[1]];
  EXPECT_EQ(within, std::uint64_t(kColumnRows));
  EXPECT_EQ(seams.creases, 12u + 8u) << "edges of the room, and of a box without a bottom";
  // A cut's two sides differ by rounding once the level is small, large or far from its origin.
  for (const auto& [scale, at] :
       {std::pair(1e-3f, glm::vec3(0.0f)), std::pair(1e3f, glm::vec3(0.0f)), std::pair(1.0f, glm::vec3(1000, 10, -500))}) {
    const Seams other = findSeams(level(scale, at));
    EXPECT_EQ(other.smooth.size(), seams.smooth.size()) << scale;
    EXPECT_EQ(other.creases, seams.creases) << scale;
  }
}

TEST(Seams, OneChartInTwoMaterialsHasNone) {
  // Two objects side by side in the plane and in the map: nothing parts their texels.
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.quad({0, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  b.quad({1, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  for (std::size_t i = 0; i < 4; ++i) b.scene.mapUv[4 + i] = b.scene.mapUv[i] + glm::vec2(b.scene.mapUv[1].x - b.scene.mapUv[0].x, 0.0f);
  b.scene.mapUv[4] = b.scene.mapUv[1];
  b.scene.mapUv[6] = b.scene.mapUv[3];
  EXPECT_TRUE(findSeams(b.scene).smooth.empty());
  EXPECT_EQ(findSeams(b.scene).creases, 0u);
}

TEST(Seams, LargestJumpFallsToAFifthAndBelowTheStandardError) {
  const Open& o = openLevel();
  LightMapValues closed = o.baked.values;
  const SeamResult result = o.close(closed);
  for (const auto& [name, first, last] :
       {std::tuple("column", std::uint32_t(kColumn), std::uint32_t(kColumn)), std::tuple("ball", std::uint32_t(kBall), kBall + 5u),
        std::tuple("shelf", std::uint32_t(kShelf), std::uint32_t(kShelfFine))}) {
    const Worst before = worstOf(o, o.open, first, last), after = worstOf(o, closed, first, last);
    std::printf("figure: %-6s largest jump %.3f to %.3f lx, %.2f %% to %.2f %%, RMS %.2f %% to %.3f %%, %.1f to %.2f standard errors\n",
                name, before.jump, after.jump, 100 * before.relative, 100 * after.relative, 100 * before.rms, 100 * after.rms,
                before.errors, after.errors);
    EXPECT_LT(after.jump, before.jump / 5.0) << name;
    EXPECT_LT(after.errors, 1.0) << name;
  }
  EXPECT_LT(result.after.largest, result.before.largest / 5.0);
  EXPECT_LT(result.after.relativeRms, result.before.relativeRms / 5.0);
  EXPECT_GT(result.moved, 100u);
}

TEST(Seams, CreasesAndAllElseKeepTheirBytes) {
  const Open& o = openLevel();
  LightMapValues closed = o.baked.values;
  o.close(closed);
  std::uint64_t moved = 0;
  for (std::size_t i = 0; i < o.baked.map.size(); ++i) {
    const std::uint32_t from = o.padding.from[i];
    const std::uint32_t object = from == kNone ? kNone : o.baked.map.object[from];
    const bool same = std::memcmp(&closed.direct[i], &o.open.direct[i], sizeof(Rgb)) == 0 &&
                      std::memcmp(&closed.indirect[i], &o.open.indirect[i], sizeof(Rgb)) == 0;
    moved += !same;
    if (object >= kColumn && object <= kShelfFine) continue;
    EXPECT_TRUE(same) << "texel " << i;
  }
  EXPECT_GT(moved, 100u);
  EXPECT_EQ(std::memcmp(closed.error.data(), o.open.error.data(), o.open.error.size() * sizeof(Rgb)), 0);
}

TEST(Seams, NoTexelMovesBeyondItsLimitAndLayersKeepTheirRatio) {
  const Open& o = openLevel();
  LightMapValues closed = o.baked.values;
  const SeamResult result = o.close(closed);
  const auto total = [](const LightMapValues& v, std::size_t i) { return glm::dvec3(v.direct[i]) + glm::dvec3(v.indirect[i]); };
  double largest = 0.0, squares = 0.0, n = 0.0, sum = 0.0;
  for (std::size_t i = 0; i < o.baked.map.size(); ++i) {
    if (!o.covered(i)) continue;
    const glm::dvec3 E = total(o.open, i), move = glm::abs(total(closed, i) - E);
    glm::dvec3 slope(0.0);
    for (const std::size_t k : {i - 1, i + 1, i - kSide, i + kSide})
      if (k < o.baked.map.size() && o.baked.map.chart[k] == o.baked.map.chart[i]) slope = glm::max(slope, glm::abs(total(o.open, k) - E));
    const glm::dvec3 limit = glm::min(kSeamErrors * glm::dvec3(o.open.error[i]) + kSeamBounds * (0.5 * slope + 0.25 * kGoal * E), 0.5 * E);
    squares += glm::dot(move, move);
    sum += E.x + E.y + E.z;
    n += 3.0;
    for (int c = 0; c < 3; ++c) {
      EXPECT_LE(move[c], limit[c] * (1.0 + 1e-5) + 1e-12) << "texel " << i;
      largest = std::max(largest, move[c] / std::max(1e-30, E[c]));
      EXPECT_GE(closed.direct[i][c], 0.0f);
      EXPECT_GE(closed.indirect[i][c], 0.0f);
      EXPECT_NEAR(double(closed.direct[i][c]) * double(o.open.indirect[i][c]), double(o.open.direct[i][c]) * double(closed.indirect[i][c]),
                  1e-6 * E[c] * E[c]);
    }
  }
  EXPECT_NEAR(largest, result.largestMove, 1e-6);
  EXPECT_NEAR(std::sqrt(squares / n) / (sum / n), result.rmsMove, 1e-6);
  EXPECT_LE(result.limited, result.texels / 20) << "limits are wide enough for most";
}

TEST(Seams, PaddingBeyondLookupsFollowsItsTexel) {
  const Open& o = openLevel();
  LightMapValues closed = o.baked.values;
  o.close(closed);
  // Texels that no lookup reads: more than one from all that is covered.
  std::uint64_t checked = 0;
  for (int y = 2; y < kSide - 2; ++y)
    for (int x = 2; x < kSide - 2; ++x) {
      bool far = true;
      for (int v = -1; v <= 1; ++v)
        for (int u = -1; u <= 1; ++u) far &= !o.covered(std::size_t(y + v) * kSide + std::size_t(x + u));
      const std::size_t i = std::size_t(y) * kSide + std::size_t(x);
      const std::uint32_t from = o.padding.from[i];
      if (!far || from == kNone) continue;
      ++checked;
      EXPECT_EQ(closed.direct[i], closed.direct[from]);
      EXPECT_EQ(closed.indirect[i], closed.indirect[from]);
    }
  EXPECT_GT(checked, 100u);
}

TEST(Seams, AnyNumberOfThreadsGivesTheSameBytes) {
  const Open& o = openLevel();
  LightMapValues first = o.baked.values;
  o.close(first, 1);
  for (const int threads : {2, 7}) {
    LightMapValues other = o.baked.values;
    withThreads({.threads = threads, .onProgress = {}, .onMessage = {}}, [&] { o.close(other, threads); });
    EXPECT_EQ(std::memcmp(first.direct.data(), other.direct.data(), first.direct.size() * sizeof(Rgb)), 0) << threads;
    EXPECT_EQ(std::memcmp(first.indirect.data(), other.indirect.data(), first.indirect.size() * sizeof(Rgb)), 0) << threads;
  }
}

TEST(Seams, ALevelOfAnotherSizeGetsTheSameLight) {
  const Open large(level(1000.0f), 1000.0f);
  const Open& o = openLevel();
  LightMapValues a = o.baked.values, b = large.baked.values;
  const SeamResult ra = o.close(a), rb = large.close(b);
  EXPECT_EQ(ra.texels, rb.texels);
  EXPECT_LT(rb.after.relativeRms, rb.before.relativeRms / 5.0);
  EXPECT_NEAR(rb.after.relativeRms / ra.after.relativeRms, 1.0, 0.5);
}

}  // namespace
}  // namespace lmc
