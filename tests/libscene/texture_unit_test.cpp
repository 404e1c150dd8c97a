#include "libscene/texture.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lmc {
namespace {

constexpr float kRounding = 1e-6f;  // a few steps of a float near 1

/// One triangle with UVs (0, 0), (1, 0), (0, 1) and a picture of two texels, black and white, side by side.
Scene twoTexels() {
  Scene scene;
  scene.positions_m = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  scene.uv0 = scene.uv1 = {{0, 0}, {1, 0}, {0, 1}};
  scene.triangles = {{0, 1, 2}};
  scene.triangleObject = {0};
  scene.objects.resize(1);
  scene.materials.resize(1);
  scene.materials[0].metallic = 0.0f;
  scene.images.emplace_back(2, 1, glm::u8vec4(0, 0, 0, 255));
  scene.images[0].at(1, 0) = glm::u8vec4(255);
  scene.materials[0].baseColorTexture.image = 0;
  return scene;
}

float greyAt(const Scene& scene, float u) { return reflectanceAt(scene, 0, {u, 0.0f}).r; }

TEST(Texture, TexelCentresShowTheirTexel) {
  const Scene scene = twoTexels();
  EXPECT_NEAR(greyAt(scene, 0.25f), 0.0f, kRounding);
  EXPECT_NEAR(greyAt(scene, 0.75f), 1.0f, kRounding);
  EXPECT_NEAR(greyAt(scene, 0.5f), 0.5f, kRounding);
}

TEST(Texture, TheEdgeFollowsTheWrapMode) {
  Scene scene = twoTexels();
  Texture& texture = scene.materials[0].baseColorTexture;
  EXPECT_NEAR(greyAt(scene, 0.0f), 0.5f, kRounding);  // half of the texel on the far side
  texture.wrapU = Wrap::Clamp;
  EXPECT_NEAR(greyAt(scene, 0.0f), 0.0f, kRounding);
  texture.transform[2] = glm::vec3(1, 0, 1);  // one picture further
  EXPECT_NEAR(greyAt(scene, 0.25f), 1.0f, kRounding);
  texture.wrapU = Wrap::Mirror;
  EXPECT_NEAR(greyAt(scene, 0.25f), 1.0f, kRounding);  // 1.25 is 0.75 from the other side
  texture.wrapU = Wrap::Repeat;
  EXPECT_NEAR(greyAt(scene, 0.25f), 0.0f, kRounding);
}

TEST(Texture, NearestTakesTheTexelItIsIn) {
  Scene scene = twoTexels();
  scene.materials[0].baseColorTexture.nearest = true;
  EXPECT_EQ(greyAt(scene, 0.49f), 0.0f);
  EXPECT_EQ(greyAt(scene, 0.51f), 1.0f);
}

TEST(Texture, ColourIsDecodedFromSrgbAndMetallicIsNot) {
  Scene scene = twoTexels();
  scene.images[0] = Image<glm::u8vec4>(1, 1, glm::u8vec4(128, 128, 128, 128));
  EXPECT_NEAR(greyAt(scene, 0.3f), 0.2158605f, kRounding);  // ((128/255 + 0.055) / 1.055)^2.4
  EXPECT_NEAR(alphaAt(scene, 0, {0.3f, 0.3f}), 128.0f / 255.0f, kRounding);
  scene.materials[0].baseColorTexture = {};
  scene.materials[0].metallicTexture.image = 0;
  scene.materials[0].metallic = 1.0f;
  EXPECT_NEAR(greyAt(scene, 0.3f), 1.0f - 128.0f / 255.0f, kRounding);
}

TEST(Texture, VertexColoursMultiply) {
  Scene scene = twoTexels();
  scene.colors = {glm::vec4(0.5f), glm::vec4(1.0f), glm::vec4(1.0f)};
  EXPECT_NEAR(greyAt(scene, 0.75f), 0.875f, kRounding);
}

TEST(Texture, TheSecondUvSetIsUsedWhereAskedFor) {
  Scene scene = twoTexels();
  scene.uv0 = {glm::vec2(0.25f), glm::vec2(0.25f), glm::vec2(0.25f)};
  scene.materials[0].baseColorTexture.uvSet = 1;
  EXPECT_NEAR(greyAt(scene, 0.75f), 1.0f, kRounding);
}

TEST(Texture, FarAndBrokenUvsStayFinite) {
  Scene scene = twoTexels();
  for (const float u : {1e30f, -1e30f, INFINITY, NAN}) {
    scene.uv0[1].x = u;
    EXPECT_TRUE(std::isfinite(greyAt(scene, 0.5f))) << u;
  }
}

TEST(Texture, MeansAreOverTheArea) {
  Scene scene = twoTexels();
  scene.materials[0].baseColorTexture.nearest = true;
  // Of the triangle 3/4 lies left of u = 1/2. 4096 points at most: one in a hundred lies on a wrong side.
  EXPECT_NEAR(meanReflectance(scene, 0).r, 0.25f, 0.01f);
  scene.images[0] = Image<glm::u8vec4>(64, 64, glm::u8vec4(0));
  for (int y = 0; y < 64; ++y)
    for (int x = 32; x < 64; ++x) scene.images[0].at(x, y) = glm::u8vec4(255);
  EXPECT_NEAR(meanReflectance(scene, 0).r, 0.25f, 0.01f);
}

TEST(Texture, MeansOfAPartAreOverThePart) {
  Scene scene = twoTexels();
  scene.materials[0].baseColorTexture.nearest = true;
  scene.images[0] = Image<glm::u8vec4>(64, 64, glm::u8vec4(0));
  for (int y = 0; y < 64; ++y)
    for (int x = 32; x < 64; ++x) scene.images[0].at(x, y) = glm::u8vec4(255);
  // Cut in the middle of the first edge; the halves have equal areas.
  const Rgb first = meanReflectance(scene, 0, {glm::vec2(0, 0), glm::vec2(0.5f, 0), glm::vec2(0, 1)}),
            second = meanReflectance(scene, 0, {glm::vec2(0.5f, 0), glm::vec2(1, 0), glm::vec2(0, 1)});
  EXPECT_EQ(first, Rgb(0.0f)) << "left of the white half";
  // 1024 texels, 32 * 32 points: the 32 of them on the line between black and white may count as either.
  EXPECT_NEAR(second.r, 0.5f, 0.5f / 32.0f + 1e-3f) << "half of this part lies in the white half";
}

TEST(Texture, MeansWithoutATextureAreExact) {
  Scene scene = twoTexels();
  scene.materials[0].baseColorTexture = {};
  scene.materials[0].baseColor = {0.3f, 0.2f, 0.1f, 1.0f};
  EXPECT_EQ(meanReflectance(scene, 0), Rgb(0.3f, 0.2f, 0.1f));
}

TEST(Texture, MeansOfAMaskAreOverItsOpaquePart) {
  Scene scene = twoTexels();
  scene.images[0].at(0, 0) = glm::u8vec4(255, 255, 255, 0);
  scene.images[0].at(1, 0) = glm::u8vec4(0, 255, 0, 255);
  scene.materials[0].baseColorTexture.nearest = true;
  scene.materials[0].alpha = Material::Alpha::Mask;
  EXPECT_EQ(meanReflectance(scene, 0), Rgb(0, 1, 0));
}

}  // namespace
}  // namespace lmc
