/// Path tracing of texels against closed forms.
#include <gtest/gtest.h>

#include <cmath>

#include "libradiosity/form_factor.h"
#include "libradiosity/path_tracer.h"
#include "libscene/constants.h"
#include "libscene/rng.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

constexpr int kSide = 64;
constexpr std::uint32_t kStreams = 16;

struct Estimate {
  glm::dvec3 mean{0.0}, error{0.0};  ///< standard error, from independent streams
};

/// Of the texel (x, y).
Estimate illuminance(const Scene& scene, int x, int y, std::uint32_t paths, const PathOptions& options = {}) {
  const Run run;
  const Charts charts = findCharts(scene, kSide, run);
  const TexelMap texels(scene, charts, kSide);
  const Tracer tracer(scene);
  const PathTracer tracing(scene, tracer, options);
  const TexelTile tile = texels.texels(0);
  const TexelSampler sampler(scene, tile, tile.at(x, y));
  glm::dvec3 sum(0.0), squares(0.0);
  for (std::uint32_t s = 0; s < kStreams; ++s) {
    const glm::dvec3 e = tracing.sum(sampler, combine(7, s), 0, paths) / double(paths);
    sum += e;
    squares += e * e;
  }
  Estimate out;
  out.mean = sum / double(kStreams);
  out.error = glm::sqrt(glm::max(squares / double(kStreams) - out.mean * out.mean, 0.0) / double(kStreams - 1));
  return out;
}

// Five standard errors of 16 streams: Student's t with 15 degrees of freedom goes beyond in 2 of 10,000. The last term: rounding.
double allowed(double error, double value) { return 5.0 * error + 1e-6 * value; }

/// A floor of 2 m with its middle in the origin, of the first cell (texels 1.6 to 14.4): texel (8, 8) is at 2 m x (6.9/12.8 - 1/2) from it.
void addFloor(test::SceneBuilder& s, float reflectance = 0.0f) {
  s.quad(glm::vec3(-1, 0, 1), glm::vec3(2, 0, 0), glm::vec3(0, 0, -2), s.material(Rgb(reflectance)));
}
constexpr double kMiddle_m = 2.0 * (8.5 - 1.6) / 12.8 - 1.0;

TEST(PathTracer, FurnaceGivesTheClosedForm) {
  for (const float rho : {0.0f, 0.5f, 0.9f, 0.99f}) {
    const Estimate e = illuminance(furnace(rho, 1.0f), 8, 8, 4096);
    EXPECT_NEAR(e.mean.x, kPi / (1.0 - double(rho)), allowed(e.error.x, e.mean.x)) << rho;
    EXPECT_LT(e.error.x, 0.02 * e.mean.x) << rho;
  }
}

TEST(PathTracer, BouncesAreCounted) {
  // Each bounce adds pi L rho^k.
  double exact = kPi, term = kPi;
  for (int k = 0; k <= 3; ++k) {
    const Estimate e = illuminance(furnace(0.5f, 1.0f), 8, 8, 2048, {.bounces = k});
    EXPECT_NEAR(e.mean.x, exact, allowed(e.error.x, e.mean.x)) << k;
    term *= 0.5;
    exact += term;
  }
}

TEST(PathTracer, ColoursKeepApart) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.9f, 0.5f, 0.0f), Rgb(1.0f, 2.0f, 3.0f));
  b.room(glm::vec3(0), glm::vec3(3, 2, 4), {m, m, m, m, m, m});
  const Estimate e = illuminance(b.scene, 8, 8, 4096);
  EXPECT_NEAR(e.mean.x, kPi / 0.1, allowed(e.error.x, e.mean.x));
  EXPECT_NEAR(e.mean.y, 2.0 * kPi / 0.5, allowed(e.error.y, e.mean.y));
  EXPECT_NEAR(e.mean.z, 3.0 * kPi, allowed(e.error.z, e.mean.z));
}

TEST(PathTracer, OpenFloorSeesTheSky) {
  test::SceneBuilder s;
  addFloor(s, 0.7f);
  s.scene.sky = Rgb(2.0f);
  const Estimate e = illuminance(s.scene, 8, 8, 256);
  EXPECT_NEAR(e.mean.x, 2.0 * kPi, 1e-6);  // nothing is in the way: every path says the same
}

TEST(PathTracer, PanelGivesItsFormFactor) {
  // Near enough for places on it alone to be noisy, large enough for cosine rays to find it.
  for (const double height : {0.2, 1.0, 5.0}) {
    test::SceneBuilder s;
    addFloor(s);
    s.quad(glm::vec3(-0.5f, float(height), -0.5f), glm::vec3(1, 0, 0), glm::vec3(0, 0, 1), s.material(Rgb(0.0f), Rgb(3.0f)));
    const Estimate e = illuminance(s.scene, 8, 8, 8192);
    // Mean over the texel, 0.16 m wide, by 16 x 16 middles of squares: off by less than 1/1000 of what the factor bends, and it bends
    // little.
    double mean = 0.0;
    const double h = double(float(height));
    for (int y = 0; y < 16; ++y)
      for (int x = 0; x < 16; ++x) {
        const glm::dvec3 at(kMiddle_m + 2.0 / 12.8 * ((x + 0.5) / 16 - 0.5), 0.0, -kMiddle_m + 2.0 / 12.8 * ((y + 0.5) / 16 - 0.5));
        const std::array<glm::dvec3, 4> corner{{{-0.5, h, -0.5}, {0.5, h, -0.5}, {0.5, h, 0.5}, {-0.5, h, 0.5}}};
        mean += (elementToPolygon(at, glm::dvec3(0, 1, 0), std::array<glm::dvec3, 3>{corner[0], corner[1], corner[2]}) +
                 elementToPolygon(at, glm::dvec3(0, 1, 0), std::array<glm::dvec3, 3>{corner[0], corner[2], corner[3]})) /
                256.0;
      }
    EXPECT_NEAR(e.mean.x, 3.0 * kPi * mean, allowed(e.error.x, e.mean.x) + 1e-3 * e.mean.x) << height;
    EXPECT_LT(e.error.x, 0.01 * e.mean.x) << height;
  }
}

TEST(PathTracer, LampGivesTheInverseSquareLaw) {
  for (const std::size_t lamps : {1u, 12u, 100u}) {  // asked one by one, weighed, drawn first
    test::SceneBuilder s;
    addFloor(s);
    Light l;
    l.path = "/lamp";
    l.position_m = glm::dvec3(0, 2, 0);
    l.intensity = Rgb(10.0f / float(lamps));
    for (std::size_t k = 0; k < lamps; ++k) s.scene.lights.push_back(l);
    const Estimate e = illuminance(s.scene, 8, 8, 1024);
    // I cos/d^2 = I h/(h^2 + r^2)^1.5, r^2 the mean over the texel of side w: its middle's and 2 w^2/12. The next term, 15/8 var(r^2)/16,
    // is 1.2e-5.
    const double r2 = 2.0 * kMiddle_m * kMiddle_m + 2.0 * std::pow(2.0 / 12.8, 2.0) / 12.0;
    EXPECT_NEAR(e.mean.x, 10.0 * 2.0 / std::pow(4.0 + r2, 1.5), allowed(e.error.x, e.mean.x) + 2e-5 * e.mean.x) << lamps;
  }
}

TEST(PathTracer, TexelHalfInShadowHasHalfTheLight) {
  test::SceneBuilder s;
  addFloor(s);
  // A wall whose shadow by a vertical sun ends in the texel's middle.
  s.quad(glm::vec3(float(kMiddle_m), 1, -2), glm::vec3(4, 0, 0), glm::vec3(0, 0, 4), s.material(Rgb(0.0f)));
  Light sun;
  sun.path = "/sun";
  sun.kind = Light::Kind::Directional;
  sun.direction = glm::dvec3(0, -1, 0);
  sun.intensity = Rgb(6.0f);
  s.scene.lights.push_back(sun);
  const Estimate e = illuminance(s.scene, 8, 8, 1024);
  EXPECT_NEAR(e.mean.x, 3.0, 6.0 / 1024 + 1e-3);  // a (0, 10, 2)-net is off by at most a point in an interval; the wall's edge is a float
}

TEST(PathTracer, PathsHaveAddresses) {
  const Scene scene = furnace(0.5f, 1.0f);
  const lmc::Run run;
  const Charts charts = findCharts(scene, kSide, run);
  const TexelMap texels(scene, charts, kSide);
  const Tracer tracer(scene);
  const PathTracer tracing(scene, tracer);
  const TexelTile tile = texels.texels(0);
  const TexelSampler sampler(scene, tile, tile.at(8, 8));
  const glm::dvec3 whole = tracing.sum(sampler, 1, 0, 700), parts = tracing.sum(sampler, 1, 0, 300) + tracing.sum(sampler, 1, 300, 700);
  EXPECT_NEAR(whole.x, parts.x, 1e-9 * whole.x);  // the order of the sum alone is another
  EXPECT_NE(whole.x, tracing.sum(sampler, 2, 0, 700).x);
}

}  // namespace
}  // namespace lmc
