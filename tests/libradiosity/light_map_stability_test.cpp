/// The same must come out when it should: for any number of threads, at another place, at another size.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <span>

#include "tests/support/bake_scene.h"
#include "tests/support/hard_case.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

using test::bakeScene;
using test::expectWithin;
using test::litRoom;
using test::relativeRms;

TEST(LightMap, SameBytesForAnyNumberOfThreads) {
  const Scene scene = litRoom();
  const test::Baked one = bakeScene(scene, {.threads = 1});
  for (const int threads : {2, 7}) {
    const test::Baked many = bakeScene(scene, {.threads = threads});
    EXPECT_EQ(std::memcmp(one.values.direct.data(), many.values.direct.data(), one.map.size() * sizeof(Rgb)), 0) << threads;
    EXPECT_EQ(std::memcmp(one.values.indirect.data(), many.values.indirect.data(), one.map.size() * sizeof(Rgb)), 0) << threads;
    EXPECT_EQ(std::memcmp(one.values.error.data(), many.values.error.data(), one.map.size() * sizeof(Rgb)), 0) << threads;
    EXPECT_EQ(one.rays, many.rays);
  }
}

TEST(LightMap, InterpolatedIsWithinTheStatedErrorsOfGathered) {
  const Scene scene = litRoom();
  const test::Baked all = bakeScene(scene, {.side = 128, .solver = Solver::Stored, .interpolate = false}),
                    few = bakeScene(scene, {.side = 128, .solver = Solver::Stored});
  const double off = relativeRms(all, few);
  expectWithin({"interpolated against gathered at every texel, room with lamp and shelf", "RMS difference", off,
                few.ledger.estimate + all.ledger.estimate, "%", "sum of the stated errors of both"});
  EXPECT_NEAR(few.ledger.mean, all.ledger.mean, 0.25 * (few.ledger.estimate + all.ledger.estimate) * all.ledger.mean);
  EXPECT_EQ(all.ledger.gathered, all.ledger.texels);
  EXPECT_EQ(all.ledger.interpolation, 0.0);
  EXPECT_LE(few.ledger.bound95, 0.02) << "the goal";
}

TEST(LightMap, APlainRoomTakesLessThanHalfOfTheHemisphereRays) {
  test::SceneBuilder s;
  const auto white = s.material(Rgb(0.7f)), lamp = s.material(Rgb(0.0f), Rgb(2.0f));
  s.room({0, 0, 0}, {3, 2.5f, 4}, {white, white, white, white, white, white});
  s.quad({1, 2.4f, 1}, {1, 0, 0}, {0, 0, 1}, lamp);
  const test::Baked all = bakeScene(s.scene, {.side = 128, .solver = Solver::Stored, .interpolate = false}),
                    few = bakeScene(s.scene, {.side = 128, .solver = Solver::Stored});
  const auto hemisphereRays = [](const test::Baked& b) {
    std::uint64_t sum = 0;
    for (const std::uint32_t r : b.map.rays) sum += 2 * std::uint64_t(r);
    return double(sum);
  };
  expectWithin({"interpolated against gathered, plain room", "hemisphere rays, of those at every texel",
                hemisphereRays(few) / hemisphereRays(all), 0.5, "%", "what it is for"});
  expectWithin({"interpolated against gathered, plain room", "RMS difference", relativeRms(all, few),
                few.ledger.estimate + all.ledger.estimate, "%", "sum of the stated errors of both"});
}

TEST(LightMap, DimRoomBehindADoorKeepsItsLimit) {
  test::SceneBuilder s;
  const auto white = s.material(Rgb(0.6f));
  s.room({0, 0, 0}, {3, 2.5f, 3}, {white, white, white, white, white, white});
  s.room({3.1f, 0, 0}, {6.1f, 2.5f, 3}, {white, white, white, white, white, white});
  // The walls between them (objects 1 and 6) shrink to both sides' walls beside a door of 0.8 m, whose jambs stay open to nothing.
  const auto narrow = [&](std::uint32_t object) {
    for (glm::vec3& p : std::span(s.scene.positions_m).subspan(4 * std::size_t(object), 4)) p.z = std::max(p.z, 0.8f);
  };
  narrow(1);
  narrow(6);
  s.quad({3, 0, 0.8f}, {0, 2.5f, 0}, {0.1f, 0, 0}, white);   // jamb
  s.quad({3, 0, 0}, {0.1f, 0, 0}, {0, 2.5f, 0}, white);      // the other jamb
  s.quad({3, 0, 0.8f}, {0.1f, 0, 0}, {0, 0, -0.8f}, white);  // sill
  s.quad({3, 2.5f, 0}, {0.1f, 0, 0}, {0, 0, 0.8f}, white);   // lintel
  Light l;
  l.path = "/lamp";
  l.position_m = {0.7, 2.0, 2.6};  // behind the wall for all of the other room but what is near the door
  l.intensity = Rgb(10.0f);
  s.scene.lights.push_back(l);
  const test::Baked few = bakeScene(s.scene, {.side = 128, .patchSize_m = 0.3, .solver = Solver::Stored}),
                    all = bakeScene(s.scene, {.side = 128, .patchSize_m = 0.3, .solver = Solver::Stored, .interpolate = false, .seed = 2});
  double squares = 0.0, mean = 0.0, n = 0.0;
  for (std::size_t i = 0; i < all.map.size(); ++i) {
    if (all.map.chart[i] == kNone || all.map.object[i] < 6 || all.map.object[i] > 11) continue;
    const glm::dvec3 e = glm::dvec3(all.values.direct[i] + all.values.indirect[i]),
                     d = glm::dvec3(few.values.direct[i] + few.values.indirect[i]) - e;
    squares += glm::dot(d, d) / 3.0;
    mean += (e.x + e.y + e.z) / 3.0;
    n += 1.0;
  }
  mean /= n;
  const double off = std::sqrt(squares / n) / mean;
  EXPECT_LT(mean, 0.2 * all.ledger.mean);
  expectWithin(
      {"dim room behind a door", "worst object, stated", few.ledger.worstObject, kObjectLimit * 0.02, "%", "three times the goal"});
  expectWithin(
      {"dim room behind a door, baked twice", "RMS difference there", off, 2.0 * kObjectLimit * 0.02, "%", "both may be off by the limit"});
}

TEST(LightMap, ADroppedLampMovesNoOthersSamples) {
  Scene scene = litRoom();
  const test::Baked with = bakeScene(scene, {.bounce = false});
  scene.lights[0].intensity = Rgb(0.0f);
  const test::Baked dark = bakeScene(scene, {.bounce = false});
  scene.lights.clear();
  const test::Baked without = bakeScene(scene, {.bounce = false});
  EXPECT_EQ(std::memcmp(dark.values.direct.data(), without.values.direct.data(), dark.map.size() * sizeof(Rgb)), 0);
  EXPECT_GT(with.ledger.mean, without.ledger.mean);
}

TEST(LightMap, LitRoomBesideADarkOneStaysDark) {
  test::SceneBuilder s;
  const auto white = s.material(Rgb(0.8f));
  s.room({0, 0, 0}, {2, 2, 2}, {white, white, white, white, white, white});
  s.room({2, 0, 0}, {4, 2, 2}, {white, white, white, white, white, white});  // the walls touch, back to back
  Light l;
  l.path = "/lamp";
  l.position_m = {1, 1, 1};
  l.intensity = Rgb(100.0f);
  s.scene.lights.push_back(l);
  const test::Baked b = bakeScene(s.scene, {.side = 96});
  double most = 0.0;
  for (std::size_t i = 0; i < b.map.size(); ++i)
    if (b.map.chart[i] != kNone && b.map.object[i] >= 6) most = std::max(most, double(b.values.direct[i].x + b.values.indirect[i].x));
  expectWithin({"lit room beside a dark one, walls back to back", "brightest dark texel, of the level's mean", most / b.ledger.mean, 1e-6,
                "", "walls are closed"});
}

TEST(ErrorLedger, EstimateAgreesWithTheSpreadOverSeeds) {
  // The RMS difference of two independent bakes is sqrt(2) times the noise of one.
  const Scene scene = litRoom();
  const test::Baked a = bakeScene(scene, {.goal = 0.04});
  Scene other = scene;
  // Charts moved by one texel: the same texels at other addresses, and so other random numbers.
  for (auto& uv : other.mapUv) uv += glm::vec2(1.0f / 64.0f, 0.0f);
  const test::Baked b = bakeScene(other, {.goal = 0.04});
  double sum = 0.0, n = 0.0;
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 63; ++x) {
      const std::size_t i = std::size_t(y) * 64 + std::size_t(x), k = i + 1;
      if (a.map.chart[i] == kNone || b.map.chart[k] == kNone) continue;
      const glm::dvec3 d = glm::dvec3(a.values.direct[i] + a.values.indirect[i]) - glm::dvec3(b.values.direct[k] + b.values.indirect[k]);
      sum += glm::dot(d, d) / 3.0;
      n += 1.0;
    }
  const double measured = std::sqrt(sum / n / 2.0) / a.ledger.mean;
  EXPECT_GT(a.ledger.noise, measured / 1.5);
  EXPECT_LT(a.ledger.noise, measured * 1.5);
}

}  // namespace
}  // namespace lmc
