/// Every trap of the lighting formulas, against values worked out by hand.
#include "shaders/formulas.h"

#include <gmock/gmock.h>

#include <glm/gtc/matrix_transform.hpp>

#include "libscene/constants.h"
#include "shaders/sampling.h"
#include "shaders/view.h"

namespace lmc::shaders {
namespace {

using glm::dvec3;

constexpr double kRounding = 1e-14;  // a few operations on numbers near 1, 2e-16 each
void expectNear(const dvec3& a, const dvec3& b) { EXPECT_LT(glm::length(a - b), kRounding) << a.x << ' ' << a.y << ' ' << a.z; }

// Light comes down at 45 degrees onto a floor: it leaves upwards, its way along the floor unchanged.
TEST(Reflection, LeavesTheSurfaceAndKeepsItsWayAlongIt) {
  const double h = std::sqrt(0.5);
  expectNear(reflection({h, -h, 0}, {0, 1, 0}), {h, h, 0});
  EXPECT_GT(reflection({h, -h, 0}, {0, 1, 0}).y, 0.0);  // the opposite sign would send it into the floor
}

TEST(Reflection, TakesIncidentThenNormal) {
  const dvec3 travelling = glm::normalize(dvec3(1, -2, 0)), normal(0, 1, 0);
  expectNear(reflection(travelling, normal), glm::normalize(dvec3(1, 2, 0)));
  EXPECT_GT(glm::length(reflection(normal, travelling) - reflection(travelling, normal)), 0.5);
}

TEST(Specular, IsFullInTheMirrorDirectionAndHalvesAsThePowerSays) {
  const dvec3 n(0, 1, 0), toLight = glm::normalize(dvec3(-1, 1, 0)), mirror = glm::normalize(dvec3(1, 1, 0));
  EXPECT_NEAR(specularShare(n, toLight, mirror, 32.0), 1.0, kRounding);
  // 60 degrees from the mirror direction: cos = 1/2.
  const dvec3 aside = std::cos(kPi / 3) * mirror + std::sin(kPi / 3) * dvec3(0, 0, 1);
  EXPECT_NEAR(specularShare(n, toLight, aside, 3.0), 0.125, kRounding);
}

TEST(Specular, IsGatedBehindTheSurfaceAndWhereLightGrazesItExactly) {
  const dvec3 n(0, 1, 0), grazing(-1, 0, 0), beyond(1, 0, 0);
  EXPECT_EQ(glm::dot(n, grazing), 0.0);
  EXPECT_EQ(specularShare(n, grazing, beyond, 4.0), 0.0);                         // n.l = 0 exactly
  EXPECT_EQ(specularShare(n, grazing, beyond, 4.0, Slip::SpecularUngated), 1.0);  // what the gate keeps away
  const dvec3 behind = glm::normalize(dvec3(-1, -0.1, 0));
  EXPECT_EQ(specularShare(n, behind, beyond, 4.0), 0.0);
  EXPECT_GT(specularShare(n, behind, beyond, 4.0, Slip::SpecularUngated), 0.9);
}

TEST(ClassicAttenuation, QuadraticFactorIsOneOverTheProduct) {
  const double range = 4.0;
  const ClassicAttenuation a{1.0, 2.0 / range, 1.0 / (range * range), 0.0, 2.0};
  // a = (range/(range + d))^2
  EXPECT_NEAR(classicAttenuation(a, 4.0), 0.25, kRounding);
  EXPECT_NEAR(classicAttenuation(a, 12.0), 1.0 / 16.0, kRounding);
  // 1/range*range is 1: at 4 m 1/(1 + 2 + 16) in place of 1/4.
  ClassicAttenuation ranged = a;
  ranged.range = 1e9;
  EXPECT_NEAR(classicAttenuation(ranged, 4.0, Slip::QuadraticPrecedence), 1.0 / 19.0, 1e-9);
}

TEST(ClassicAttenuation, SaturatesTheDifferenceSoThatLightEndsAtItsRange) {
  const ClassicAttenuation a{1.0, 0.0, 0.0, 2.0, 4.0};
  EXPECT_NEAR(classicAttenuation(a, 1.0), 1.0 - 1.0 / 16.0, kRounding);
  EXPECT_EQ(classicAttenuation(a, 2.0), 0.0);
  EXPECT_EQ(classicAttenuation(a, 4.0), 0.0);  // 1 - 2^4 = -15 before it is saturated
}

TEST(ClassicAttenuation, IsFiniteAtTheLightAndWithoutARange) {
  EXPECT_EQ(classicAttenuation({1.0, 2.0, 3.0, 5.0, 2.0}, 0.0), 1.0);
  EXPECT_EQ(classicAttenuation({0.0, 0.0, 1.0, 0.0, 2.0}, 0.0), 0.0);  // 1/0: no light, no infinity
  EXPECT_EQ(classicAttenuation({1.0, 0.0, 0.0, 0.0, 2.0}, 1e6), 1.0);  // range 0: no window
}

TEST(InverseSquare, FallsWithTheSquareEndsAtTheRangeAndIsNothingAtTheLight) {
  EXPECT_NEAR(inverseSquare(2.0, 0.0), 0.25, kRounding);
  EXPECT_NEAR(inverseSquare(1.0, 2.0), 1.0 - 1.0 / 16.0, kRounding);
  EXPECT_EQ(inverseSquare(2.0, 2.0), 0.0);
  EXPECT_EQ(inverseSquare(3.0, 2.0), 0.0);
  EXPECT_EQ(inverseSquare(0.0, 2.0), 0.0);
  EXPECT_EQ(inverseSquare(1e-200, 0.0), 0.0);  // its square is no number
}

TEST(SpotCone, IsFullInsideGoneOutsideAndSquaredBetween) {
  EXPECT_EQ(spotCone(1.0, 0.9, 0.5), 1.0);
  EXPECT_EQ(spotCone(0.4, 0.9, 0.5), 0.0);
  EXPECT_NEAR(spotCone(0.7, 0.9, 0.5), 0.25, kRounding);
  EXPECT_EQ(spotCone(0.5, 0.5, 0.5), 0.0);  // a hard edge, and no 0/0
}

TEST(LightAt, ALightAtThePlaceItselfGivesNothingAndNoNan) {
  ShadedLight light;
  light.light.intensity = light.specular = Rgb(5.0f);
  for (const bool classic : {false, true}) {
    if (classic) light.light.classic = ClassicAttenuation{0.0, 0.0, 1.0, 0.0, 2.0};
    const LightParts parts = lightAt({dvec3(0.0), {0, 1, 0}, {0, 1, 0}, dvec3(1.0), 8.0, false}, light);
    expectNear(parts.diffuse, dvec3(0.0));
    expectNear(parts.specular, dvec3(0.0));
  }
}

TEST(LightAt, PhysicalLightsShowEOverPiAndClassicOnesTheirColour) {
  ShadedLight light;
  light.light.kind = Light::Kind::Directional;
  light.light.direction = {0, -1, 0};
  light.light.intensity = Rgb(2.0f);
  const Place floor{dvec3(0.0), {0, 1, 0}, {0, 1, 0}, dvec3(0.0), 1.0, false};
  expectNear(lightAt(floor, light).diffuse, dvec3(2.0 / kPi));
  light.light.classic.emplace();
  expectNear(lightAt(floor, light).diffuse, dvec3(2.0));
}

TEST(LightAt, WhereThereIsALightMapABakedLightHasOnlyItsSpecularPartLeft) {
  ShadedLight light;
  light.light.kind = Light::Kind::Directional;
  light.light.direction = {0, -1, 0};
  light.light.intensity = light.specular = light.ambient = Rgb(1.0f);
  light.light.classic.emplace();
  light.baked = true;
  const Place place{dvec3(0.0), {0, 1, 0}, {0, 1, 0}, dvec3(1.0), 4.0, true};
  const LightParts mapped = lightAt(place, light);
  expectNear(mapped.diffuse + mapped.ambient, dvec3(0.0));
  expectNear(mapped.specular, dvec3(1.0));
  light.baked = false;
  expectNear(lightAt(place, light).diffuse, dvec3(1.0));
  expectNear(lightAt(place, light).ambient, dvec3(1.0));
}

// A ramp of 45 degrees squeezed to a quarter of its height: its normal turns towards the vertical, which the world matrix turns it from.
TEST(NormalMatrix, IsTheInverseTransposeUnderAScaleThatDiffersByAxis) {
  const glm::dmat4 world = glm::scale(glm::dmat4(1.0), dvec3(1.0, 0.25, 1.0));
  const dvec3 normal = glm::normalize(normalMatrix(world) * glm::normalize(dvec3(-1, 1, 0)));
  const dvec3 along = glm::dmat3(world) * dvec3(1, 1, 0);
  EXPECT_NEAR(glm::dot(normal, along), 0.0, kRounding);
  expectNear(normal, glm::normalize(dvec3(-1, 4, 0)));
  EXPECT_GT(std::abs(glm::dot(glm::normalize(glm::dmat3(world) * glm::normalize(dvec3(-1, 1, 0))), glm::normalize(along))), 0.5);
}

TEST(NormalMatrix, KeepsNormalsOutsideUnderAMirrorAndIsFiniteForAFlatNode) {
  const glm::dmat4 mirror = glm::scale(glm::dmat4(1.0), dvec3(-1.0, 1.0, 1.0));
  expectNear(normalMatrix(mirror) * dvec3(1, 0, 0), {-1, 0, 0});
  expectNear(normalMatrix(mirror) * dvec3(0, 1, 0), {0, 1, 0});
  const glm::dmat4 flat = glm::scale(glm::dmat4(1.0), dvec3(1.0, 0.0, 1.0));
  expectNear(normalMatrix(flat) * dvec3(0, 1, 0), {0, 1, 0});
}

// UVs that run to the left: the tangent points left, and V stays up only with determinant -1.
TEST(WorldFrame, MirroredUvsKeepTheirBitangentByTheDeterminant) {
  const TangentFrame plain = worldFrame(glm::dmat4(1.0), {0, 0, 1}, {1, 0, 0, 1}),
                     mirrored = worldFrame(glm::dmat4(1.0), {0, 0, 1}, {-1, 0, 0, -1});
  expectNear(plain.bitangent, {0, 1, 0});
  expectNear(mirrored.bitangent, {0, 1, 0});
  expectNear(worldFrame(glm::dmat4(1.0), {0, 0, 1}, {-1, 0, 0, -1}, Slip::DeterminantIgnored).bitangent, {0, -1, 0});
}

TEST(WorldFrame, TheBitangentIsThatOfTheMeshCarriedIntoTheWorldWhateverTheNodeDoes) {
  const dvec3 normal = glm::normalize(dvec3(0.2, 0.3, 1.0)), tangent = glm::normalize(glm::cross(dvec3(0, 1, 0), normal));
  for (const double determinant : {1.0, -1.0})
    for (const dvec3& scale : {dvec3(1, 1, 1), dvec3(-1, 1, 1), dvec3(1, -1, 1), dvec3(-1, -1, -1)}) {
      const glm::dmat4 world = glm::scale(glm::rotate(glm::dmat4(1.0), 0.7, dvec3(1, 2, 3)), scale);
      const TangentFrame frame = worldFrame(world, normal, glm::dvec4(tangent, determinant));
      expectNear(frame.bitangent, glm::dmat3(world) * (determinant * glm::cross(normal, tangent)));
    }
}

TEST(WorldFrame, StaysAtRightAnglesUnderAScaleThatDiffersByAxis) {
  const glm::dmat4 world = glm::scale(glm::dmat4(1.0), dvec3(3.0, 0.5, 1.0));
  const dvec3 normal = glm::normalize(dvec3(1, 1, 0.5)), tangent = glm::normalize(glm::cross(dvec3(0, 1, 0), normal));
  const TangentFrame f = worldFrame(world, normal, glm::dvec4(tangent, 1.0));
  EXPECT_NEAR(glm::dot(f.normal, f.tangent), 0.0, kRounding);
  EXPECT_NEAR(glm::length(f.tangent), 1.0, kRounding);
  EXPECT_NEAR(glm::length(f.bitangent), 1.0, kRounding);
}

TEST(Colours, AndNormalsTurnIntoOneAnother) {
  expectNear(colourToNormal({0.5, 0.0, 1.0}), {0, -1, 1});
  expectNear(normalToColour(colourToNormal({0.2, 0.7, 0.9})), {0.2, 0.7, 0.9});
  EXPECT_NEAR(encodedSrgb(1.0), 1.0, kRounding);
  EXPECT_NEAR(linearOfSrgb({188, 0, 0, 255}).r, 0.50289, 1e-5);  // IEC 61966-2-1
}

TEST(Sampling, IsBilinearAndWrapsAsTheSamplerSays) {
  Scene scene;
  scene.images.emplace_back(2, 1);
  scene.images[0].pixels = {{0, 0, 0, 255}, {255, 0, 0, 255}};
  Texture t;
  t.image = 0;
  const auto red = [&](double u) { return sample(scene, t, {u, 0.5}, Encoding::Linear).r; };
  EXPECT_NEAR(red(0.25), 0.0, kRounding);
  EXPECT_NEAR(red(0.5), 0.5, kRounding);
  EXPECT_NEAR(red(1.0), 0.5, kRounding);  // half of the last texel, half of the first
  EXPECT_NEAR(red(-0.75), 0.0, kRounding);
  t.wrapU = Wrap::Clamp;
  EXPECT_NEAR(red(1.0), 1.0, kRounding);
  t.wrapU = Wrap::Mirror;
  EXPECT_NEAR(red(1.25), 1.0, kRounding);
  EXPECT_NEAR(red(1.75), 0.0, kRounding);
  t.nearest = true;  // the shader's textures are bilinear whatever a file names
  EXPECT_NEAR(red(0.5), 0.5, kRounding);
}

}  // namespace
}  // namespace lmc::shaders
