/// Rays where they are hard: from surfaces, at shared edges, far from the origin.
#include <gtest/gtest.h>

#include <cmath>

#include "libscene/parallel.h"
#include "libscene/rng.h"
#include "libscene/sampling.h"
#include "libscene/texels.h"
#include "libscene/tracer.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

constexpr std::uint32_t kRays = 100000;

/// A room of 6 x 2048 triangles, turned by 0.3 rad about an odd axis, moved by `at`.
Scene turnedRoom(float at) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.room({-3, -2, -4}, {3, 2, 4}, {m, m, m, m, m, m}, 32);
  const glm::dvec3 axis = glm::normalize(glm::dvec3(1, 2, 3));
  for (auto& p : b.scene.positions_m) {
    const glm::dvec3 v(p);
    const glm::dvec3 turned = v * std::cos(0.3) + glm::cross(axis, v) * std::sin(0.3) + axis * glm::dot(axis, v) * (1 - std::cos(0.3));
    p = glm::vec3(turned) + at;
  }
  b.scene.extent_m = 5.0f + std::abs(at);
  return b.scene;
}

class FromSurfaces : public testing::TestWithParam<float> {};

TEST_P(FromSurfaces, NoRayLeavesAClosedRoomOrMeetsItsOwnStart) {
  const Scene scene = turnedRoom(GetParam());
  const Tracer tracer(scene);
  std::uint32_t left = 0, own = 0, backs = 0;
  for (std::uint32_t i = 0; i < kRays; ++i) {
    const glm::vec4 u = Sobol4(combine(i, 3)).point(0);
    const std::uint32_t triangle = std::uint32_t(mix64(i) % scene.triangles.size());
    const float s = std::sqrt(u.z);
    const SurfacePoint p = surfacePoint(scene, triangle, {double(s * (1 - u.w)), double(s * u.w)});
    const glm::dvec3 d = frameAbout(p.geometricNormal) * cosineHemisphere({u.x, u.y});
    const Hit hit = tracer.closest(Ray{tracer.lifted(p.position_m, p.geometricNormal), glm::vec3(d), INFINITY}, Purpose::Gather);
    left += !hit;
    own += hit && hit.triangle == triangle;
    backs += hit && !hit.front;
  }
  EXPECT_EQ(own, 0u);
  // A start within one rounding of the next wall may fall behind it: rays * edge length * ulp / area of these faces (0.83 / m). Levels are
  // recentred, so that the ulp is that of their size.
  const double ulp_m = double(tracer.lift_m()) / 4.0, expected = kRays * 0.83 * ulp_m;
  EXPECT_LE(left + backs, 1.0 + 2.0 * expected);
  EXPECT_EQ(tracer.rays(Purpose::Gather), kRays);
}

INSTANTIATE_TEST_SUITE_P(Offset, FromSurfaces, testing::Values(0.0f, 1e3f, 1e4f));

TEST(Tracer, HitsAreTheSameForAnyNumberOfThreadsAndBatches) {
  const Scene scene = turnedRoom(0.0f);
  std::vector<Ray> rays;
  for (std::uint32_t i = 0; i < kRays; ++i) {
    const glm::vec4 u = Sobol4(combine(i, 4)).point(0);
    // Half of them at shared vertices, where it is hardest to say which triangle is hit.
    glm::vec3 d = glm::vec3(u.x, u.y, u.z) - 0.5f;
    if (i % 2) d = scene.positions_m[mix64(i) % scene.positions_m.size()];
    rays.push_back({glm::vec3(0.1f, 0.2f, 0.3f) * u.w, d, INFINITY});
  }
  std::vector<std::vector<Hit>> all;
  for (const int threads : {1, 2, 7}) {
    lmc::Run run;
    run.threads = threads;
    all.emplace_back(rays.size());
    withThreads(run, [&] {
      const Tracer tracer(scene);  // built by so many threads, too
      parallelFor(run, rays.size() / 100, 1, [&](std::size_t b) {
        tracer.closest({rays.data() + 100 * b, 100}, {all.back().data() + 100 * b, 100}, Purpose::Gather);
      });
    });
  }
  const Tracer tracer(scene);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Hit one = tracer.closest(rays[i], Purpose::Gather);
    for (const auto& hits : all) {
      ASSERT_EQ(hits[i].triangle, one.triangle) << i;
      ASSERT_EQ(hits[i].bary, one.bary) << i;
    }
  }
}

TEST(Tracer, MaskedHolesLetRaysThrough) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.scene.materials[m].alpha = Material::Alpha::Mask;
  b.scene.materials[m].alphaCutoff = 0.5f;
  Image<glm::u8vec4> picture(2, 1);
  picture.at(0, 0) = {255, 255, 255, 255};
  picture.at(1, 0) = {255, 255, 255, 0};  // right half is a hole
  b.scene.images.push_back(picture);
  b.scene.materials[m].baseColorTexture.image = 0;
  b.scene.materials[m].baseColorTexture.nearest = true;
  b.quad({0, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  const Tracer tracer(b.scene);
  EXPECT_TRUE(tracer.occluded(Ray{{0.3f, 1, -0.5f}, {0, -1, 0}, INFINITY}, Purpose::Shadow));
  EXPECT_FALSE(tracer.occluded(Ray{{0.7f, 1, -0.5f}, {0, -1, 0}, INFINITY}, Purpose::Shadow));
  EXPECT_FALSE(tracer.closest(Ray{{0.7f, 1, -0.5f}, {0, -1, 0}, INFINITY}, Purpose::Shadow));
  EXPECT_TRUE(tracer.closest(Ray{{0.3f, 1, -0.5f}, {0, -1, 0}, INFINITY}, Purpose::Shadow));
}

TEST(Tracer, WhatDoesNotCastIsNotThere) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f)), glass = b.material(Rgb(0.5f));
  b.scene.materials[glass].alpha = Material::Alpha::Blend;
  b.quad({0, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  b.quad({0, 1, 0}, {1, 0, 0}, {0, 0, -1}, glass);
  b.scene.objects[0].cast = false;
  const Tracer tracer(b.scene);
  EXPECT_FALSE(tracer.occluded(Ray{{0.5f, 2, -0.5f}, {0, -1, 0}, INFINITY}, Purpose::Shadow));
}

}  // namespace
}  // namespace lmc
