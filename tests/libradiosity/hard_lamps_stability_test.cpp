/// Lamps where formulas are near their poles. Rows go to docs/stability.md.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "libradiosity/form_factor_bodies.h"
#include "libscene/constants.h"
#include "tests/support/bake_scene.h"
#include "tests/support/hard_case.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

using test::bakeScene;
using test::expectWithin;
using test::pointLight;

constexpr float kSide_m = 4.0f;
constexpr double kDoubt = 1e-5;  // values are floats, and places come from float vertices

/// A floor of 4 m with a map of about `side` texels, and a lamp.
test::Baked litFloor(const Light& light, int side) {
  test::SceneBuilder s(1);
  s.quad({0, 0, 0}, {0, 0, kSide_m}, {kSide_m, 0, 0}, s.material(Rgb(0.5f)));
  s.scene.lights.push_back(light);
  return bakeScene(s.scene, {.side = side, .bounce = false});
}

/// The square of the floor that a texel covers; cells have a margin of a tenth. u runs along z, v along x.
std::array<glm::dvec3, 4> squareOf(int x, int y, int side) {
  const auto along = [&](int k) { return std::clamp((double(k) / side - 0.1) / 0.8, 0.0, 1.0) * double(kSide_m); };
  const double z0 = along(x), z1 = along(x + 1), x0 = along(y), x1 = along(y + 1);
  return {glm::dvec3(x0, 0, z0), {x0, 0, z1}, {x1, 0, z1}, {x1, 0, z0}};
}

double areaOf(const std::array<glm::dvec3, 4>& q) { return glm::length(glm::cross(q[1] - q[0], q[3] - q[0])); }

TEST(HardLamps, OneMillimetreFromAFloorOfBigTexels) {
  // A texel's mean is the lamp's flux through its square: E = I omega/A.
  for (const double height_m : {1e-1, 1e-2, 1e-3, 1e-4}) {
    const int side = 20;
    const test::Baked b = litFloor(pointLight({1.63, height_m, 2.41}, 10.0f), side);
    double worst = 0.0, flux = 0.0, exactFlux = 0.0, most = 0.0;
    for (int y = 0; y < side; ++y)
      for (int x = 0; x < side; ++x) {
        const std::size_t i = std::size_t(y * side + x);
        if (b.map.chart[i] == kNone) continue;
        const auto square = squareOf(x, y, side);
        const double omega = std::abs(solidAngle_sr({1.63, height_m, 2.41}, square)), area = areaOf(square);
        flux += double(b.values.direct[i].r) * area;
        exactFlux += 10.0 * omega;
        worst = std::max(worst, std::abs(double(b.values.direct[i].r) - 10.0 * omega / area) * area / (10.0 * 2.0 * kPi));
        most = std::max(most, double(b.values.direct[i].r) * area / (4.0 * kPi * 10.0));
      }
    const std::string what = fmt::format("lamp {:g} mm above a floor of texels of 0.25 m", 1e3 * height_m);
    expectWithin({what, "flux through the floor", std::abs(flux / exactFlux - 1.0), 0.02, "%", "the goal"});
    expectWithin({what, "worst texel, of the lamp's flux downwards", worst, 0.02, "%", "the goal"});
    expectWithin({what, "most of the lamp's light in a texel", most, 0.5 + kDoubt, "%", "half of 4 pi I: a plane sees no more"});
  }
}

TEST(HardLamps, OnASurfaceInACornerAndInsideAWall) {
  struct Place {
    const char* what;
    glm::dvec3 at_m;
  };
  // A box of 3 x 2 x 4 m; each face's flux is what a lamp in the room sends through it, seen from the limit of places in front of it.
  for (const Place& p : {Place{"lamp on a floor", {1.2, 0.0, 1.7}},
                         {"lamp on an edge of two walls", {0.0, 1.1, 0.0}},
                         {"lamp in a corner", {0.0, 0.0, 0.0}},
                         {"lamp 1 cm behind a wall", {-0.01, 1.0, 2.0}}}) {
    test::SceneBuilder s;
    const auto m = s.material(Rgb(0.0f));
    s.room({0, 0, 0}, {3, 2, 4}, {m, m, m, m, m, m});
    s.scene.lights.push_back(pointLight(p.at_m, 10.0f));
    const test::Baked b = bakeScene(s.scene, {.side = 128, .bounce = false});
    const double areas[6] = {8, 8, 12, 12, 6, 6};
    double flux = 0.0, least = 0.0;
    for (std::uint32_t f = 0; f < 6; ++f) flux += areas[f] * b.mean(f).x / (4.0 * kPi * 10.0);
    for (std::size_t i = 0; i < b.map.size(); ++i) {
      ASSERT_TRUE(std::isfinite(b.values.direct[i].r + b.values.error[i].r)) << p.what;
      least = std::min(least, double(b.values.direct[i].r));
    }
    EXPECT_EQ(least, 0.0);
    const bool inside = p.at_m.x >= 0.0;
    const double zeros = (p.at_m.x == 0.0) + (p.at_m.y == 0.0) + (p.at_m.z == 0.0);
    const double exact = inside ? std::ldexp(1.0, -int(zeros)) : 0.0;  // share of the sphere that lies in the room
    expectWithin({p.what, inside ? "light sent into the room against light received" : "light that gets in, of 4 pi I",
                  std::abs(flux - exact) / std::max(exact, 1e-300) * (inside ? 1.0 : 0.0) + (inside ? 0.0 : flux), inside ? 0.02 : 0.0, "%",
                  inside ? "the goal" : "walls are closed"});
  }
}

/// E of a wall of radiance 1, 2 m high from z = 0 to 4 m at x = 0, on the floor before it: the closed form of a perpendicular rectangle,
/// seen from its foot; mean over a square.
double beforeAWall(const std::array<glm::dvec3, 4>& square) {
  constexpr int kPlaces = 16;
  double sum = 0.0;
  for (int i = 0; i < kPlaces; ++i)
    for (int k = 0; k < kPlaces; ++k) {
      const glm::dvec3 p = square[0] + (i + 0.5) / kPlaces * (square[1] - square[0]) + (k + 0.5) / kPlaces * (square[3] - square[0]);
      const double slant = std::hypot(p.x, 2.0);
      for (const double b : {p.z, double(kSide_m) - p.z}) sum += 0.5 * (std::atan2(b, p.x) - p.x / slant * std::atan2(b, slant));
    }
  return sum / (kPlaces * kPlaces);
}

TEST(HardLamps, FootOfAWallThatGlows) {
  // Its triangles are smaller than a texel, and nearer to some places of it than their size: which of them is met hangs on the place.
  for (const int cuts : {1, 100}) {
    test::SceneBuilder s(2);
    s.quad({0, 0, 0}, {0, 0, kSide_m}, {kSide_m, 0, 0}, s.material(Rgb(0.5f)));
    s.quad({0, 0, 0}, {0, 2, 0}, {0, 0, kSide_m}, s.material(Rgb(0.0f), Rgb(1.0f)), cuts);
    s.scene.objects[1].receive = false;
    const int side = 100;
    const test::Baked b = bakeScene(s.scene, {.side = side, .bounce = false});
    double first = 0.0, true_ = 0.0, stated = 0.0, texels = 0.0;
    for (int y = 5; y < 8; ++y)
      for (int x = 6; x < 44; ++x) {  // the ends of the wall left out
        const std::size_t i = std::size_t(y * side + x);
        ASSERT_EQ(b.map.object[i], 0u);
        const double exact = beforeAWall(squareOf(x, y, side / 2));
        const double off = double(b.values.direct[i].r) / exact - 1.0;
        if (y == 5) first += off * off / 38.0;
        true_ += off * off;
        stated += std::pow(double(b.values.error[i].r) / exact, 2.0);
        texels += 1.0;
      }
    const std::string what = fmt::format("foot of a glowing wall of {} triangles", 2 * cuts * cuts);
    expectWithin({what, "first texels of 0.1 m, RMS", std::sqrt(first), 0.08, "%", "four times the goal"});
    expectWithin(
        {what, "RMS within 0.3 m against what is stated", std::sqrt(true_ / stated), 1.5, "", "heavy tails are seen by both halves"});
  }
}

TEST(HardLamps, SpotsOf0And90Degrees) {
  for (const double degrees : {0.0, 90.0}) {
    Light l = pointLight({2.0, 1.0, 2.0}, 10.0f);
    l.kind = Light::Kind::Spot;
    l.direction = {0, -1, 0};
    l.cosOuter = std::cos(degrees * kPi / 180.0);
    l.cosInner = 1.0;
    const int side = 80;
    const test::Baked b = litFloor(l, side);
    // 90 degrees: cone cos^2; the flux through the floor is the integral of I cos^2 over the solid angle, by the midpoint rule on 400^2.
    // 0 degrees: no light but on a ray, whose texel gets at most the cone's flux.
    double flux = 0.0, exact = 0.0;
    for (int y = 0; y < side; ++y)
      for (int x = 0; x < side; ++x)
        if (const std::size_t i = std::size_t(y * side + x); b.map.chart[i] != kNone)
          flux += double(b.values.direct[i].r) * areaOf(squareOf(x, y, side));
    const int n = 400;
    const double step = double(kSide_m) / n;
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < n; ++k) {
        const double x = (i + 0.5) * step - 2.0, z = (k + 0.5) * step - 2.0, d2 = x * x + z * z + 1.0, c = 1.0 / std::sqrt(d2);
        const double cone = std::clamp((c - l.cosOuter) / std::max(0.001, l.cosInner - l.cosOuter), 0.0, 1.0);
        exact += 10.0 * cone * cone * c / d2 * step * step;
      }
    expectWithin({fmt::format("spot of {:g} degrees", degrees), "flux through the floor, of 4 pi I", std::abs(flux - exact) / (40.0 * kPi),
                  1e-3, "%", "texels of 5 cm against h^2/12 f'' of the midpoint rule"});
  }
}

TEST(HardLamps, RangeZeroIsNoneAndAttenuationOfZerosIsDark) {
  Light endless = pointLight({2, 1, 2}, 10.0f), zeros = endless;
  endless.range_m = 0.0;
  zeros.classic = ClassicAttenuation{0.0, 0.0, 0.0, 0.0, 0.0};
  Light plain = pointLight({2, 1, 2}, 10.0f);
  const test::Baked a = litFloor(endless, 32), b = litFloor(plain, 32), c = litFloor(zeros, 32);
  double off = 0.0, most = 0.0;
  for (std::size_t i = 0; i < a.map.size(); ++i) {
    off = std::max(off, double(std::abs(a.values.direct[i].r - b.values.direct[i].r)));
    ASSERT_TRUE(std::isfinite(c.values.direct[i].r));
    most = std::max(most, double(c.values.direct[i].r));
  }
  expectWithin({"range 0", "difference from no range", off, 0.0, "lx", "0 means none"});
  expectWithin({"classic attenuation with all factors 0", "largest illuminance", most, 0.0, "lx", "1/0 is taken as no light"});
}

TEST(HardLamps, AlbedoZeroReflectsNothing) {
  test::SceneBuilder s;
  const auto black = s.material(Rgb(0.0f));
  s.room({0, 0, 0}, {3, 2, 4}, {black, black, black, black, black, black});
  s.scene.lights.push_back(pointLight({1, 1, 1}, 10.0f));
  const test::Baked b = bakeScene(s.scene);
  double most = 0.0;
  for (const Rgb& e : b.values.indirect) most = std::max(most, double(e.r));
  expectWithin({"albedo 0", "largest bounced light", most, 0.0, "lx", "nothing is reflected"});
}

}  // namespace
}  // namespace lmc
