/// Geometry as people really build it: overlaps, slivers, doubles, walls on uncut floors. Rows go to docs/stability.md.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "libradiosity/rims.h"
#include "libscene/constants.h"
#include "libscene/tracer.h"
#include "tests/support/bake_scene.h"
#include "tests/support/hard_case.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

using test::bakeScene;
using test::expectWithin;
using test::pointLight;

/// Largest difference of an object's mean from what it should be, relative; of the first `objects`.
double worstObject(const test::Baked& b, std::uint32_t objects, double exact) {
  double worst = 0.0;
  for (std::uint32_t o = 0; o < objects; ++o) worst = std::max(worst, std::abs(b.mean(o).x / exact - 1.0));
  return worst;
}

constexpr float kRho = 0.8f;
const double kFurnace = kPi / (1.0 - double(kRho));  // E of a closed room that glows with 1 cd/m^2

TEST(Overlaps, APosterInTheWallsPlaneIsLitAsTheWall) {
  // Without a poster, with one in the wall's plane, and with one a rounding before it: the room's light is the same, and the poster's is
  // that of the wall where it hangs.
  const auto room = [](float x) {
    test::SceneBuilder s;
    const auto m = s.material(Rgb(kRho));
    s.room({0, 0, 0}, {3, 2, 4}, {m, m, m, m, m, m});
    if (x > 0.0f) s.quad({x, 0, 1}, {0, 0, 2}, {0, 2, 0}, m);
    s.scene.lights.push_back(pointLight({1.1, 1.2, 1.9}, 10.0f));
    return s.scene;
  };
  const test::BakeSceneOptions options{.side = 96, .solver = Solver::Stored};
  const test::Baked bare = bakeScene(room(0.0f), options);
  for (const bool raised : {false, true}) {
    const test::Baked b = bakeScene(room(raised ? std::nextafter(3.0f, 0.0f) : 3.0f), options);
    double wall = 0.0, n = 0.0;
    for (std::size_t i = 0; i < bare.map.size(); ++i) {
      // Object 1, u along z: its middle half is where the poster hangs. Cells are 24 texels with a margin of 2.4.
      const double z = (double(i % 96) + 0.5 - 24.0 - 2.4) / 19.2 * 4.0;
      if (bare.map.chart[i] == kNone || bare.map.object[i] != 1 || z < 1.0 || z > 3.0) continue;
      wall += double(bare.values.direct[i].r + bare.values.indirect[i].r) * double(bare.coverage[i]);
      n += double(bare.coverage[i]);
    }
    const std::string what = raised ? "poster one rounding before a wall" : "poster in a wall's own plane";
    expectWithin({what, "the room's texels against those without it, RMS", test::relativeRms(bare, b),
                  bare.ledger.bound95 + b.ledger.bound95, "%", "sum of the stated bounds of both"});
    expectWithin({what, "its mean against the wall's there", std::abs(b.mean(6).x / (wall / n) - 1.0),
                  bare.ledger.bound95 + b.ledger.bound95, "%", "sum of the stated bounds of both"});
  }
}

TEST(Overlaps, WallsBackToBackFightForNoLight) {
  // Two rooms that share a wall's plane: one glows, the other is dark. Apart by nothing, by a rounding, and through each other by one.
  for (const int ulps : {0, 1, -1}) {
    test::SceneBuilder s;
    const auto bright = s.material(Rgb(kRho), Rgb(1.0f)), dark = s.material(Rgb(kRho));
    float x = 3.0f;
    for (int k = 0; k < std::abs(ulps); ++k) x = std::nextafter(x, ulps > 0 ? 10.0f : 0.0f);
    s.room({0, 0, 0}, {3, 2, 4}, {bright, bright, bright, bright, bright, bright});
    s.room({x, 0, 0}, {x + 3, 2, 4}, {dark, dark, dark, dark, dark, dark});
    const test::Baked b = bakeScene(s.scene, {.side = 96, .solver = Solver::Stored});
    double most = 0.0;
    for (std::size_t i = 0; i < b.map.size(); ++i)
      if (b.map.chart[i] != kNone && b.map.object[i] >= 6) most = std::max(most, double(b.values.direct[i].r + b.values.indirect[i].r));
    const std::string what = ulps == 0  ? "walls of two rooms in one plane"
                             : ulps > 0 ? "walls of two rooms one rounding apart"
                                        : "walls of two rooms one rounding through each other";
    expectWithin({what, "worst face of the bright room", worstObject(b, 6, kFurnace), 0.02, "%", "the goal, against pi/(1 - rho)"});
    expectWithin({what, "brightest texel of the dark room, of the bright one's light", most / kFurnace, 1e-6, "", "walls are closed"});
  }
}

TEST(Slivers, UpToAMillionToOneHarmNoOtherFace) {
  for (const float thin : {1e4f, 1e5f, 1e6f}) {
    // The floor of a furnace in two: a strip of 4 m along a wall, and the rest.
    SceneBuilder b;
    const std::uint32_t m = b.material(Rgb(kRho), Rgb(1.0f));
    const glm::vec3 X(3, 0, 0), Y(0, 2, 0), Z(0, 0, 4);
    const float w = 4.0f / thin;
    b.quad({0, 0, 0}, Y, Z, m);
    b.quad(X, Z, Y, m);
    b.quad(Y, X, Z, m);
    b.quad({0, 0, 0}, X, Y, m);
    b.quad(Z, Y, X, m);
    b.quad({w, 0, 0}, Z, {3 - w, 0, 0}, m);
    b.quad({0, 0, 0}, Z, {w, 0, 0}, m);
    const test::Baked baked = bakeScene(b.scene, {.side = 64, .patchSize_m = 0.7, .solver = Solver::Stored});
    const std::string what = fmt::format("sliver of {:g} to 1 in a floor", double(thin));
    expectWithin(
        {what, "worst other face of a glowing room", worstObject(baked, 6, kFurnace), 0.02, "%", "the goal, against pi/(1 - rho)"});
    expectWithin({what, "the sliver itself", std::abs(baked.mean(6).x / kFurnace - 1.0),
                  0.02 + 0.5 * (1.0 - double(kRho)) * std::min(1.0, double(Tracer(b.scene).lift_m()) / double(w)), "%",
                  "the goal; within 4 ulp of an emitter's plane its light, half of the direct, is left out"});
  }
}

TEST(Doubles, FacesWithoutAreaAndFacesTwiceChangeNothing) {
  Scene scene = test::litRoom();
  const test::BakeSceneOptions options{.solver = Solver::Stored};  // shooting would let both twins send
  const test::Baked plain = bakeScene(scene, options);
  // Every face a second time, by an object of its own without a place in the map, and three without area: a point, a needle, an edge there
  // and back.
  Scene more = scene;
  for (const Object& o : scene.objects) {
    Object twin = o;
    twin.path += " again";
    twin.receive = twin.inMap = false;
    twin.firstTriangle = std::uint32_t(more.triangles.size());
    for (std::uint32_t t = 0; t < o.triangleCount; ++t) more.triangles.push_back(scene.triangles[o.firstTriangle + t]);
    const std::uint32_t v = o.firstVertex;
    more.triangles.emplace_back(v, v, v);
    more.triangles.emplace_back(v, v + 1, v);
    more.triangles.emplace_back(v, v + 2, v + 2);
    twin.triangleCount = std::uint32_t(more.triangles.size()) - twin.firstTriangle;
    more.objects.push_back(twin);
    more.triangleObject.resize(more.triangles.size(), std::uint32_t(more.objects.size() - 1));
  }
  const test::Baked other = bakeScene(more, options);
  expectWithin({"every face twice, and faces without area", "RMS difference", test::relativeRms(plain, other),
                plain.ledger.bound95 + other.ledger.bound95, "%", "sum of the stated bounds of both"});
}

/// A floor of 4 m in 80 texels under a lamp, with what stands on it; `cells` squared quads, in a map of 100 times as many texels.
struct Standing {
  test::SceneBuilder s;
  std::uint32_t grey;
  explicit Standing(int cells = 2) : s(cells), grey(s.material(Rgb(0.0f))) {
    s.quad({0, 0, 0}, {0, 0, 4}, {4, 0, 0}, grey);
    s.scene.lights.push_back(pointLight({0.6, 1.5, 2.1}, 10.0f));
  }
  double exactAt(double x, double z) const {
    const double h = 1.5, d = std::sqrt((x - 0.6) * (x - 0.6) + (z - 2.1) * (z - 2.1) + h * h);
    return 10.0 * h / (d * d * d);
  }
};

TEST(Standing, WallOnAnUncutFloorMakesNoRim) {
  // Across a floor that is not cut where the wall stands: before it the closed form, behind it nothing, in the one texel between both
  // shares of it. `inset`: the wall reaches into the floor, ends on it, or ends a rounding above it.
  struct Foot {
    const char* what;
    float y;
  };
  for (const Foot& foot : {Foot{"wall standing in an uncut floor", -0.1f}, Foot{"wall standing on an uncut floor", 0.0f},
                           Foot{"wall one rounding above an uncut floor", 1e-7f}}) {
    Standing level;
    const float at = 2.013f;
    level.s.quad({at, foot.y, 0}, {0, 2, 0}, {0, 0, 4}, level.grey);
    level.s.quad({at, foot.y, 0}, {0, 0, 4}, {0, 2, 0}, level.grey);
    const int side = 200;
    const test::Baked b = bakeScene(level.s.scene, {.side = side, .bounce = false});
    double rim = 0.0, leak = 0.0, between = 0.0;
    for (int y = 0; y < side; ++y)
      for (int x = 0; x < side; ++x) {
        const std::size_t i = std::size_t(y * side + x);
        if (b.map.chart[i] == kNone || b.map.object[i] != 0) continue;
        const auto along = [&](double k) { return (k / side - 0.05) / 0.4 * 4.0; };
        const double x0 = along(y), x1 = along(y + 1), z = along(x + 0.5), e = double(b.values.direct[i].r);
        if (b.coverage[i] < 0.999f) continue;
        if (x1 < double(at)) rim = std::max(rim, std::abs(e / level.exactAt(0.5 * (x0 + x1), z) - 1.0));
        if (x0 > double(at)) leak = std::max(leak, e / level.exactAt(0.5 * (x0 + x1), z));
        if (x0 <= double(at) && x1 >= double(at)) {
          const double share = (double(at) - x0) / (x1 - x0);
          between = std::max(between, std::abs(e / level.exactAt(0.5 * (x0 + double(at)), z) - share));
        }
      }
    // The mean over 5 cm against the middle's value: h^2/24 |Laplacian E| <= 0.002 of E at 1.5 m.
    expectWithin({foot.what, "worst texel before it", rim, 0.01, "%", "noise of a texel at the goal; middle for mean 0.1 %"});
    expectWithin({foot.what, "brightest texel behind it, of E without a wall", leak, 1e-6, "", "the wall is closed"});
    expectWithin({foot.what, "texel under it: lit share off by", between, 0.06, "", "64 places along 5 cm: two strata of 1/32"});
  }
}

TEST(Standing, BoxOnAnUncutFloorDarkensWhatItCoversAlone) {
  // A texel is the mean over its square: what of it lies under a box is dark, the rest is as bright as ever.
  Standing level;
  const glm::vec3 a(2.013f, 0, -0.5f), X(1, 0, 0), Y(0, 0.5f, 0), Z(0, 0, 5);
  level.s.quad(a, Z, Y, level.grey);
  level.s.quad(a + X, Y, Z, level.grey);
  level.s.quad(a + Y, Z, X, level.grey);
  const int side = 200;
  const test::Baked b = bakeScene(level.s.scene, {.side = side, .bounce = false});
  double worst = 0.0, under = 0.0;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      const std::size_t i = std::size_t(y * side + x);
      if (b.map.chart[i] == kNone || b.map.object[i] != 0 || b.coverage[i] < 0.999f) continue;
      const auto along = [&](double k) { return (k / side - 0.05) / 0.4 * 4.0; };
      const double x0 = along(y), x1 = along(y + 1), z = along(x + 0.5), e = double(b.values.direct[i].r);
      const double free = std::clamp((2.013 - x0) / (x1 - x0), 0.0, 1.0);
      if (free > 0.0) worst = std::max(worst, std::abs(e / level.exactAt(x0 + 0.5 * free * (x1 - x0), z) - free));
      if (free == 0.0 && x1 < 3.013) under = std::max(under, e);
    }
  expectWithin({"box on an uncut floor", "worst texel before and partly under it, from the share that is free", worst, 0.06, "",
                "64 places along 5 cm: two strata of 1/32"});
  expectWithin({"box on an uncut floor", "brightest texel under it", under, 0.0, "lx", "it is closed"});
}

constexpr int kCells = 3, kSide = 100 * kCells;

/// A light map of Standing in kCells with its rims filled, for bilinear lookups along the floor.
class Filled {
 public:
  explicit Filled(const Scene& scene) : baked_(bakeScene(scene, {.side = kSide, .bounce = false})) {
    Run run;
    const Charts charts = findCharts(scene, kSide, run);
    const TexelMap texels(scene, charts, kSide);
    const Tracer tracer(scene);
    before_ = baked_.values.direct;
    free_ = freePlaces(baked_.values, baked_.map, scene, texels, tracer, run);
    result = fillRims(baked_.values, baked_.map, free_);
  }

  double before(double x, double z) const { return lookUp(before_, x, z); }
  double after(double x, double z) const { return lookUp(baked_.values.direct, x, z); }

  RimResult result;

 private:
  double lookUp(const TexelArray<Rgb>& map, double x, double z) const {
    // The floor's chart: rows along x, columns along z, in its cell but for a margin of a tenth.
    const auto at = [&](double m) { return (m / 4.0 * 0.8 + 0.1) / kCells * kSide - 0.5; };
    const double row = at(x), column = at(z), v = row - std::floor(row), u = column - std::floor(column);
    const auto texel = [&](int dy, int dx) {
      return double(map[std::size_t((int(std::floor(row)) + dy) * kSide + int(std::floor(column)) + dx)].r);
    };
    return (1.0 - v) * ((1.0 - u) * texel(0, 0) + u * texel(0, 1)) + v * ((1.0 - u) * texel(1, 0) + u * texel(1, 1));
  }

  test::Baked baked_;
  TexelArray<Rgb> before_;
  TexelArray<std::uint8_t> free_;
};

/// A solid on the floor of Standing, `from` this x on, over all of it in z.
void addSolid(Standing& level, float from, float thick) {
  const glm::vec3 a(from, 0, -0.5f), X(thick, 0, 0), Y(0, 0.5f, 0), Z(0, 0, 5);
  level.s.quad(a, Z, Y, level.grey);
  level.s.quad(a + X, Y, Z, level.grey);
  level.s.quad(a + Y, Z, X, level.grey);
  level.s.quad(a, Y, X, level.grey);
  level.s.quad(a + Z, X, Y, level.grey);
}

TEST(Standing, LookupsAtTheFootOfASolidShowNoRimWhereRimsAreFilled) {
  // Wherever the foot lies within a texel of 5 cm.
  for (const float from : {2.0005f, 2.013f, 2.025f, 2.037f, 2.0495f}) {
    Standing level(kCells);
    addSolid(level, from, 1.0f);
    const Filled filled(level.s.scene);
    double rim = 0.0, worst = 0.0;
    for (double z = 0.5; z <= 3.5; z += 0.07)
      for (double x = 1.8; x < double(from); x += 0.003) {
        const double exact = level.exactAt(x, z);
        rim = std::max(rim, 1.0 - filled.before(x, z) / exact);
        worst = std::max(worst, std::abs(filled.after(x, z) / exact - 1.0));
      }
    EXPECT_GT(rim, 0.2) << "there is nothing to fill";
    EXPECT_GT(filled.result.texels, 50u);
    // d ln E/dx = 3 (x - x0)/d^2 is largest, 1 per metre, at x - x0 = h = 1.5 m. A texel less than half of which is free, nearly all of a
    // lookup at the most, has the value of one that lies a texel farther from the solid.
    expectWithin({fmt::format("solid on an uncut floor from {:g} m, rims filled", double(from)), "worst lookup before it", worst, 0.06, "%",
                  "the light's change over 5 cm, 5 %; noise of a texel at the goal"});
  }
}

TEST(Standing, FillingRimsLetsNoLightThroughAThinSolid) {
  // Thinner than the texel that it parts: what lies behind it is dark, and lookups there stay so.
  Standing level(kCells);
  addSolid(level, 2.015f, 0.02f);
  const Filled filled(level.s.scene);
  double before = 0.0, after = 0.0;
  for (double z = 0.5; z <= 3.5; z += 0.07)
    for (double x = 2.036; x < 2.3; x += 0.003) {
      before = std::max(before, filled.before(x, z) / level.exactAt(x, z));
      after = std::max(after, filled.after(x, z) / level.exactAt(x, z));
    }
  EXPECT_GT(before, 0.1) << "the mean of a texel that the solid parts";
  expectWithin({"solid of 2 cm within texels of 5 cm, rims filled", "brightest lookup behind it, of E without it", after, 0.0, "",
                "free neighbours on its dark side speak for the texel"});
}

TEST(Standing, WhereNothingStandsNothingIsFilled) {
  Standing level(kCells);  // a board close above the floor, its lower side a face: dark below it, but no solid
  level.s.quad({2, 0.01f, 0}, {1, 0, 0}, {0, 0, 4}, level.grey);
  level.s.quad({2, 0.02f, 0}, {0, 0, 4}, {1, 0, 0}, level.grey);
  EXPECT_EQ(Filled(level.s.scene).result.texels, 0u);
}

}  // namespace
}  // namespace lmc
