/// The audit against maps whose error is known.
#include <gtest/gtest.h>

#include <cmath>

#include "libradiosity/audit.h"
#include "libscene/constants.h"
#include "tests/support/bake_scene.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

constexpr int kSide = 64;
constexpr std::uint64_t kRays = 2'000'000;

/// A map of direct light alone, and what belongs to it.
struct Direct {
  explicit Direct(const Scene& level, std::uint64_t seed = 1) : scene(level), tracer(scene), light(scene, tracer, true) {
    run.seed = seed;
    charts = findCharts(scene, kSide, run);
    texels = std::make_unique<TexelMap>(scene, charts, kSide);
    map = startMap(scene, *texels, run);
    bakeDirect(map, scene, *texels, light, {0.02}, run);
    value = values(map, scene);
    ledger = lmc::ledger(map, scene, {});
    stated = statedErrors(map, scene);
  }
  AuditResult audited(const PathOptions& paths, std::uint64_t rays = kRays) {
    return audit(map, value, scene, *texels, tracer, stated, {rays, paths}, ledger, run);
  }
  const Scene scene;
  const Tracer tracer;
  const DirectLight light;
  Run run;
  Charts charts;
  std::unique_ptr<TexelMap> texels;
  LightMap map;
  LightMapValues value;
  ErrorLedger ledger;
  TexelArray<float> stated;
};

TEST(Audit, BouncesThatAMapLacksAreFound) {
  // E = pi without bounces, 2 pi with all: off by its own mean.
  Direct d(furnace(0.5f, 1.0f));
  const double before = d.ledger.bound95;
  EXPECT_LT(before, 0.01);
  const AuditResult a = d.audited({});
  ASSERT_GT(a.drawn, 0u);
  EXPECT_NEAR(a.found.bias, -1.0, 5.0 * a.found.biasError);
  EXPECT_LT(a.found.biasError, 0.05);
  EXPECT_NEAR(a.found.square, 1.0, 5.0 * a.found.squareError + 5.0 * a.found.biasError);
  EXPECT_TRUE(a.contradicts);
  EXPECT_GE(d.ledger.bound95, 0.95);
  EXPECT_GE(d.ledger.estimate, 0.95);
}

TEST(Audit, WhatWasNotAskedForIsNoError) {
  Direct d(furnace(0.5f, 1.0f));
  const double before = d.ledger.bound95;
  const AuditResult a = d.audited({.bounces = 0});
  ASSERT_GT(a.drawn, 0u);
  EXPECT_LT(std::abs(a.found.bias), 5.0 * a.found.biasError + 1e-3);
  EXPECT_FALSE(a.contradicts);
  EXPECT_EQ(d.ledger.bound95, before);
}

/// A floor with a thing on it, in sun: edges of shadows.
Scene shadows() {
  test::SceneBuilder s;
  const auto m = s.material(Rgb(0.0f));
  s.quad(glm::vec3(-1, 0, 1), glm::vec3(2, 0, 0), glm::vec3(0, 0, -2), m);
  for (int k = 0; k < 4; ++k)
    s.quad(glm::vec3(-0.9f + 0.45f * float(k), 0.3f, 0.5f), glm::vec3(0.21f, 0.1f, 0), glm::vec3(0.05f, 0, -0.9f), m);
  Light sun;
  sun.path = "/sun";
  sun.kind = Light::Kind::Directional;
  sun.direction = glm::normalize(glm::dvec3(0.3, -1, 0.2));
  sun.intensity = Rgb(5.0f);
  s.scene.lights.push_back(sun);
  return s.scene;
}

TEST(Audit, IntervalsCoverWhatTheMapStates) {
  // The map's own noise is known (its halves are independent), so intervals of 95 % must cover it most of the time: of 12 seeds at least 9
  // (8 or fewer: 2 in 10,000).
  int covered = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    Direct d(shadows(), seed);
    const AuditResult a = d.audited({.bounces = 0});
    EXPECT_FALSE(a.contradicts) << seed;
    const double noise = d.ledger.noise * d.ledger.noise;
    covered += std::abs(a.found.square - noise) <= 1.96 * a.found.squareError + 0.3 * noise;
    EXPECT_GT(a.classes[std::size_t(TexelClass::Edge)].drawn, 8u);
  }
  EXPECT_GE(covered, 9);
}

TEST(Audit, WrongTexelsAmongManyRaiseTheBound) {
  Direct d(shadows());
  // Half of the texels a fifth too bright: RMS 0.2 sqrt(1/2) of about the mean, while nothing states it.
  for (std::size_t i = 0; i < d.map.size(); i += 2) d.value.direct[i] *= 1.2f;
  const AuditResult a = d.audited({.bounces = 0});
  EXPECT_TRUE(a.contradicts);
  EXPECT_GT(d.ledger.bound95, 0.1);
  EXPECT_LT(d.ledger.bound95, 0.4);
}

TEST(Audit, RaysStayWithinTheLimit) {
  for (const std::uint64_t rays : {20'000ull, 300'000ull, 3'000'000ull}) {
    Direct d(furnace(0.5f, 1.0f));
    const AuditResult a = d.audited({}, rays);
    EXPECT_LE(a.rays, rays);
    if (a.drawn > 0) {
      EXPECT_GT(a.rays, rays / 2);
    }
  }
  Direct d(furnace(0.5f, 1.0f));
  EXPECT_EQ(d.audited({}, 1000).drawn, 0u);  // too few to say anything
}

}  // namespace
}  // namespace lmc
