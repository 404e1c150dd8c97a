/// The same level said otherwise: scaled, turned, shuffled, cut anew. Rows go to docs/stability.md.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "libscene/constants.h"
#include "libscene/rng.h"
#include "tests/support/bake_scene.h"
#include "tests/support/hard_case.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

using test::bakeScene;
using test::expectWithin;
using test::litRoom;
using test::relativeRms;

constexpr const char* kStated = "sum of the stated bounds of both";

TEST(SameLight, ScaledByAPowerOfTwoIsTheSameInBits) {
  // Floats scale by powers of two without rounding: a bit that differs is a length that was written into the program.
  const test::Baked metre = bakeScene(litRoom());
  for (const int power : {-10, 13}) {
    const float scale = std::ldexp(1.0f, power);
    const test::Baked other = bakeScene(litRoom(scale), {.patchSize_m = 0.5 * double(scale)});
    std::size_t apart = 0;
    for (std::size_t i = 0; i < metre.map.size(); ++i)
      apart += metre.values.direct[i] != other.values.direct[i] || metre.values.indirect[i] != other.values.indirect[i];
    expectWithin({fmt::format("level scaled by 2^{}", power), "texels with another bit", double(apart), 0.0, "", "scaling rounds nothing"});
  }
}

TEST(SameLight, ScaledByAnyNumberIsWithinTheStatedErrors) {
  const test::Baked metre = bakeScene(litRoom());
  for (const float scale : {1e-3f, 1e-2f, 1e2f, 1e4f}) {
    const test::Baked other = bakeScene(litRoom(scale), {.patchSize_m = 0.5 * double(scale)});
    expectWithin({fmt::format("level scaled by {:g}", scale), "RMS difference", relativeRms(metre, other),
                  metre.ledger.bound95 + other.ledger.bound95, "%", kStated});
  }
}

/// Turned about an odd axis, in double, rounded once.
Scene turned(Scene s, double angle) {
  const glm::dvec3 axis = glm::normalize(glm::dvec3(1, 2, 3));
  const auto turn = [&](const glm::dvec3& v) {
    return v * std::cos(angle) + glm::cross(axis, v) * std::sin(angle) + axis * glm::dot(axis, v) * (1.0 - std::cos(angle));
  };
  s.extent_m = 0.0f;
  for (glm::vec3& p : s.positions_m) {
    p = glm::vec3(turn(glm::dvec3(p)));
    for (int k = 0; k < 3; ++k) s.extent_m = std::max(s.extent_m, std::abs(p[k]));
  }
  for (glm::vec3& n : s.normals) n = glm::vec3(turn(glm::dvec3(n)));
  for (Light& l : s.lights) {
    l.position_m = turn(l.position_m);
    l.direction = turn(l.direction);
  }
  return s;
}

TEST(SameLight, TurnedByOddAnglesIsWithinTheStatedErrors) {
  const test::Baked straight = bakeScene(litRoom());
  for (const double degrees : {0.01, 37.0, 211.0}) {
    const test::Baked other = bakeScene(turned(litRoom(), degrees * kPi / 180.0));
    expectWithin({fmt::format("level turned by {:g} degrees about (1, 2, 3)", degrees), "RMS difference", relativeRms(straight, other),
                  straight.ledger.bound95 + other.ledger.bound95, "%", kStated});
  }
}

TEST(SameLight, ShuffledTrianglesAndVerticesAreWithinTheStatedErrors) {
  const Scene scene = litRoom(1.0f, glm::vec3(0.0f), 6);
  const test::Baked plain = bakeScene(scene);
  Scene other = scene;
  std::uint64_t drawn = 0;
  const auto draw = [&](std::uint32_t below) { return std::uint32_t(mix64(++drawn) % below); };
  for (const Object& o : other.objects) {
    const auto swapVertices = [&](std::uint32_t a, std::uint32_t b) {
      std::swap(other.positions_m[a], other.positions_m[b]);
      std::swap(other.normals[a], other.normals[b]);
      std::swap(other.uv0[a], other.uv0[b]);
      std::swap(other.mapUv[a], other.mapUv[b]);
      for (std::uint32_t t = o.firstTriangle; t < o.firstTriangle + o.triangleCount; ++t)
        for (int k = 0; k < 3; ++k) {
          std::uint32_t& v = other.triangles[t][k];
          v = v == a ? b : v == b ? a : v;
        }
    };
    for (std::uint32_t v = o.vertexCount; v-- > 1;) swapVertices(o.firstVertex + v, o.firstVertex + draw(v + 1));
    for (std::uint32_t t = o.triangleCount; t-- > 1;) {
      glm::uvec3& corner = other.triangles[o.firstTriangle + t];
      std::swap(corner, other.triangles[o.firstTriangle + draw(t + 1)]);
      corner = {corner.y, corner.z, corner.x};
    }
  }
  const test::Baked shuffled = bakeScene(other);
  ASSERT_EQ(std::ranges::count(plain.map.chart, kNone), std::ranges::count(shuffled.map.chart, kNone));
  expectWithin({"triangles, their corners and vertices shuffled", "RMS difference", relativeRms(plain, shuffled),
                plain.ledger.bound95 + shuffled.ledger.bound95, "%", kStated});
}

TEST(SameLight, FacesCutAnewAreWithinTheStatedErrors) {
  const test::Baked plain = bakeScene(litRoom());
  for (const int cuts : {5, 16}) {
    const test::Baked other = bakeScene(litRoom(1.0f, glm::vec3(0.0f), cuts));
    expectWithin({fmt::format("faces cut into {} triangles instead of 2", 2 * cuts * cuts), "RMS difference", relativeRms(plain, other),
                  plain.ledger.bound95 + other.ledger.bound95, "%", kStated});
  }
  Scene flipped = litRoom();  // the other diagonal of every quad
  for (std::size_t t = 0; t + 1 < flipped.triangles.size(); t += 2) {
    const glm::uvec3 a = flipped.triangles[t], b = flipped.triangles[t + 1];
    flipped.triangles[t] = {a.x, a.y, b.z};
    flipped.triangles[t + 1] = {a.y, a.z, b.z};
  }
  const test::Baked other = bakeScene(flipped);
  expectWithin({"faces cut along their other diagonal", "RMS difference", relativeRms(plain, other),
                plain.ledger.bound95 + other.ledger.bound95, "%", kStated});
}

TEST(SameLight, FloatVerticesFarAwayAreOffByTheirRoundingAlone) {
  // A floor of 4 m, a lamp 2 m above it. Each coordinate is off by half a unit in the last place of `far`; E = I h/d^3 with d >= h moves by
  // at most (1 + 3) delta/h of itself, delta the length of that.
  for (const float far : {1e3f, 1e5f, 1e6f}) {
    const auto bakeAt = [](float at) {
      test::SceneBuilder s(1);
      const auto m = s.material(Rgb(0.5f));
      // As the loader leaves it: vertices rounded to float in the file, then recentred.
      const auto rounded = [&](glm::vec3 v) { return (v + glm::vec3(at)) - glm::vec3(at); };
      const glm::vec3 a = rounded({0.1f, 0.3f, 0.2f}), b = rounded({4.1f, 0.3f, 0.2f}), d = rounded({0.1f, 0.3f, 4.2f});
      s.quad(a, d - a, b - a, m);
      s.scene.lights.push_back(test::pointLight({2.1, 2.3, 2.2}, 10.0f));
      return bakeScene(s.scene, {.side = 32, .bounce = false});
    };
    const test::Baked near = bakeAt(0.0f), moved = bakeAt(far);
    const double delta = 0.5 * std::sqrt(3.0) * double(std::nextafter(far + 5.0f, std::numeric_limits<float>::infinity()) - (far + 5.0f));
    double worst = 0.0;
    for (std::size_t i = 0; i < near.map.size(); ++i)
      if (near.map.chart[i] != kNone)
        worst = std::max(worst, std::abs(double(moved.values.direct[i].r) / double(near.values.direct[i].r) - 1.0));
    expectWithin({fmt::format("float vertices at {:g} m", far), "worst texel", worst, 4.0 * delta / 2.0 + 1e-5, "%",
                  "4 x rounding over the lamp's height, 1e-5 for values in float"});
  }
}

}  // namespace
}  // namespace lmc
