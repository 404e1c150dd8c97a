#include "libradiosity/patch_mesh.h"

#include <gtest/gtest.h>

#include <map>

#include "libscene/rng.h"
#include "libscene/texels.h"
#include "libscene/tracer.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

double totalArea(const PatchMesh& m) {
  double a = 0.0;
  for (const Patch& p : m.patches) a += p.area_m2;
  return a;
}

TEST(PatchMesh, KeepsTheAreaAndTheSizeLimit) {
  const Scene scene = test::furnace(0.5f, 1.0f);
  const PatchMesh m = makePatches(scene, {.size_m = 0.25}, {});
  EXPECT_NEAR(totalArea(m), 2.0 * (3 * 2 + 2 * 4 + 3 * 4), 1e-9);
  for (const Patch& p : m.patches) EXPECT_LE(2.0 * p.radius_m, 2.0 * std::sqrt(2.0) * 0.25 * 1.01);
}

TEST(PatchMesh, SmallTrianglesAreGrouped) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.quad({0, 0, 0}, {4, 0, 0}, {0, 0, -4}, m, 64);  // 8192 triangles
  const PatchMesh mesh = makePatches(b.scene, {.size_m = 0.5}, {});
  EXPECT_LT(mesh.patches.size(), 300u);
  EXPECT_GT(mesh.patches.size(), 60u);
  EXPECT_EQ(mesh.leaves.size(), 8192u);
}

TEST(PatchMesh, EveryPlaceFindsThePatchThatHoldsIt) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.quad({0, 0, 0}, {3, 0.5f, 0}, {0.2f, 0, -2}, m, 3);
  const PatchMesh mesh = makePatches(b.scene, {.size_m = 0.2}, {});
  for (std::uint32_t i = 0; i < mesh.patches.size(); ++i) {
    const Sobol4 numbers(i);
    for (std::uint32_t k = 0; k < 16; ++k) {
      const auto [triangle, bary] = mesh.sample(mesh.patches[i], numbers.point2(k));
      EXPECT_EQ(mesh.patchAt(triangle, glm::vec2(bary), true), i);
      EXPECT_EQ(mesh.patchAt(triangle, glm::vec2(bary), false), kNone) << "one-sided: its back is nobody's";
    }
  }
}

TEST(PatchMesh, DoubleSidedSurfacesAreTwoPatchesBackToBack) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.scene.materials[m].doubleSided = true;
  b.quad({0, 0, 0}, {1, 0, 0}, {0, 0, -1}, m);
  const PatchMesh mesh = makePatches(b.scene, {.size_m = 0.5}, {});
  EXPECT_NEAR(totalArea(mesh), 2.0, 1e-9);
  const std::uint32_t front = mesh.patchAt(0, {0.2f, 0.2f}, true), back = mesh.patchAt(0, {0.2f, 0.2f}, false);
  EXPECT_EQ(back, front + 1);
  EXPECT_NEAR(glm::dot(mesh.patches[front].normal, mesh.patches[back].normal), -1.0, 1e-12);
}

TEST(PatchMesh, GroupsEndAtCreasesAndMaterials) {
  test::SceneBuilder b;
  const auto white = b.material(Rgb(0.8f)), dark = b.material(Rgb(0.1f));
  b.quad({0, 0, 0}, {1, 0, 0}, {0, 0, -1}, white, 8);
  b.quad({1, 0, 0}, {1, 0, 0}, {0, 0, -1}, dark, 8);   // same plane
  b.quad({0, 0, -1}, {1, 0, 0}, {0, 1, 0}, white, 8);  // upright
  const PatchMesh mesh = makePatches(b.scene, {.size_m = 10.0}, {});
  EXPECT_EQ(mesh.patches.size(), 3u);
}

TEST(PatchMesh, CapIsKeptByGrowing) {
  const Scene scene = test::furnace(0.5f, 1.0f);
  const PatchMesh mesh = makePatches(scene, {.size_m = 0.01, .maxPatches = 500}, {});
  EXPECT_LE(mesh.patches.size(), 500u);
  EXPECT_GT(mesh.size_m, 0.01);
  EXPECT_NEAR(totalArea(mesh), 52.0, 1e-9);
}

/// Places all over a scene's triangles; `exitance` of the place [m].
template <class F>
std::vector<LightAt> lightOver(const Scene& scene, F exitance) {
  std::vector<LightAt> out;
  constexpr int kAcross = 64;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t)
    for (int i = 0; i < kAcross; ++i)
      for (int j = 0; i + j < kAcross; ++j) {
        const glm::vec2 bary((float(i) + 1.0f / 3.0f) / kAcross, (float(j) + 1.0f / 3.0f) / kAcross);
        const auto c = scene.corners_m(t);
        const glm::dvec3 p = c[0] + double(bary.x) * (c[1] - c[0]) + double(bary.y) * (c[2] - c[0]);
        out.push_back({t, bary, float(area_m2(c) / (kAcross * kAcross / 2.0)), float(exitance(p))});
      }
  return out;
}

TEST(PatchMesh, EvenLightKeepsPatchesCoarse) {
  const Scene scene = test::furnace(0.5f, 1.0f);
  const std::vector<LightAt> light = lightOver(scene, [](const glm::dvec3&) { return 3.0; });
  const std::size_t coarse = makePatches(scene, {.size_m = 0.5}, {}).patches.size();
  const PatchMesh mesh = makePatches(scene, {.size_m = 0.5, .levels = 3, .light = light}, {});
  EXPECT_EQ(mesh.patches.size(), coarse);
}

TEST(PatchMesh, PatchesAreSmallWhereLightChangesAndOneLevelApartFromTheirNeighbours) {
  test::SceneBuilder b;
  b.quad({0, 0, 0}, {8, 0, 0}, {0, 0, -8}, b.material(Rgb(0.5f)));
  // The edge of a shadow across the floor.
  const std::vector<LightAt> light = lightOver(b.scene, [](const glm::dvec3& p) { return p.x + 0.3 * p.z < 2.0 ? 1.0 : 0.0; });
  const PatchMesh mesh = makePatches(b.scene, {.size_m = 1.0, .levels = 3, .light = light}, {});
  const std::size_t evenly = makePatches(b.scene, {.size_m = 0.125}, {}).patches.size();
  EXPECT_LT(mesh.patches.size(), evenly / 3) << "an edge is a line: finest patches go with its length";
  EXPECT_NEAR(totalArea(mesh), 64.0, 1e-9);
  std::uint32_t finest = 0;
  for (const Patch& p : mesh.patches) {
    const double away = std::abs(p.centre_m.x + 0.3 * p.centre_m.z - 2.0) / std::hypot(1.0, 0.3);
    // The mean over such a patch moves far more light than the limit; groups that were left over are small, and may stay.
    if (away < 0.1 * double(p.size_m) && p.area_m2 > 0.4 * double(p.size_m) * double(p.size_m))
      EXPECT_EQ(p.level, 3) << p.centre_m.x << ' ' << p.centre_m.z;
    if (away > 4.0) EXPECT_EQ(p.level, 0) << p.centre_m.x << ' ' << p.centre_m.z;
    finest += p.level == 3;
    EXPECT_LE(2.0 * p.radius_m, 2.0 * std::sqrt(2.0) * double(p.size_m) * 1.01);
  }
  EXPECT_GT(finest, 50u);
  // From any place to one beside it, across leaves of different sizes.
  const auto patchAt = [&](double x, double z) {
    const double u = x / 8.0, v = -z / 8.0;
    // A quad's triangles: (0, 0) (1, 0) (1, 1) and (0, 0) (1, 1) (0, 1).
    return u >= v ? mesh.patchAt(0, glm::vec2(u - v, v), true) : mesh.patchAt(1, glm::vec2(u, v - u), true);
  };
  for (double z = -7.995; z < 0.0; z += 0.0625)
    for (double x = 0.005; x < 7.99; x += 0.0625) {
      const Patch &here = mesh.patches[patchAt(x, z)], &right = mesh.patches[patchAt(std::min(x + 0.0625, 7.995), z)];
      EXPECT_LE(std::abs(int(here.level) - int(right.level)), 1) << x << ' ' << z;
    }
}

TEST(PatchMesh, ReflectanceIsThePatchsOwnPartOfAPicture) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(1.0f));
  b.quad({0, 0, 0}, {2, 0, 0}, {0, 0, -1}, m);
  b.scene.images.emplace_back(64, 64, glm::u8vec4(0, 0, 0, 255));
  for (int y = 0; y < 64; ++y)
    for (int x = 32; x < 64; ++x) b.scene.images[0].at(x, y) = glm::u8vec4(255);
  b.scene.materials[m].baseColorTexture.image = 0;
  const PatchMesh mesh = makePatches(b.scene, {.size_m = 0.25}, {});
  for (const Patch& p : mesh.patches) {  // but at the ends, where the picture repeats
    const double to = p.centre_m.x + p.radius_m, from = p.centre_m.x - p.radius_m;
    if (to < 0.95 && from > 0.05) EXPECT_LT(p.reflectance.r, 0.01f) << p.centre_m.x;
    if (from > 1.05 && to < 1.95) EXPECT_GT(p.reflectance.r, 0.99f) << p.centre_m.x;
  }
}

TEST(PatchMesh, NonManifoldEdgesDoNotEndTheRun) {
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  for (int i = 0; i < 3; ++i)
    b.quad({0, 0, 0}, {1, 0, 0}, {0, std::cos(2.1f * float(i)), std::sin(2.1f * float(i))}, m);  // three wings on one edge
  b.quad({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, m);                                                    // and the first once more
  const PatchMesh mesh = makePatches(b.scene, {.size_m = 0.3}, {});
  EXPECT_NEAR(totalArea(mesh), 4.0, 1e-6);
  EXPECT_GT(mesh.unjoined, 0u);
}

}  // namespace
}  // namespace lmc
