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
