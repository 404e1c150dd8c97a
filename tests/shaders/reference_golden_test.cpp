/// The GLSL reference against the oracle: two renderers that share no formula, one in GL's single precision, one in C++'s double.
#include <gmock/gmock.h>

#include "lmc/shade_level.h"
#include "shaders/check_scene.h"
#include "shaders/reference.h"
#include "tests/support/agreement.h"

namespace lmc {
namespace {

using shaders::Frame;
using shaders::Target;

constexpr double kOneOf255 = 1.0 / 255.0;
constexpr double kShareThatAgrees = 0.999;  // the rest: pixels at edges, whose side is a matter of rounding

/// Exposed and encoded, so that one of 255 is a step of a display.
Image<glm::vec4> shown(const Frame& frame, Target t) {
  Image<glm::vec4> out = frame[t];
  if (t < Target::AmbientLight || t == Target::Picture) return out;
  for (glm::vec4& p : out.pixels) p = glm::pow(glm::clamp(float(frame.exposure) * p, 0.0f, 1.0f), glm::vec4(1.0f / 2.2f));
  return out;
}

void expectAgreement(const ShadingLevel& level, const shaders::LevelMaps& maps, shaders::View view, std::initializer_list<Target> targets) {
  shaders::Reference reference(level, maps);
  const Frame gl = reference.render(view);
  view.exposure = gl.exposure;
  const Frame oracle = shaders::renderOracle(level, maps, view, lmc::Run{});
  const Image<std::uint32_t> triangles = shaders::trianglesSeen(level, view);
  const auto surfaces = std::ranges::count_if(triangles.pixels, [](std::uint32_t t) { return t != kNone; });
  EXPECT_GT(surfaces, std::ptrdiff_t(triangles.pixels.size() / 30)) << "the camera sees next to nothing";
  for (const Target t : targets) {
    const test::Agreement a = test::agreement(shown(gl, t), shown(oracle, t), triangles, kOneOf255);
    std::printf("  %-14s %s\n", std::string(shaders::kTargetNames[std::size_t(t)]).c_str(), a.text().c_str());
    EXPECT_GE(a.share(), kShareThatAgrees) << a.text();
    EXPECT_EQ(a.insideFaces, 0u) << a.text();
  }
}

struct NamedView {
  const char *name, *file, *camera;
};
void PrintTo(const NamedView& v, std::ostream* out) { *out << v.name; }

class ReferenceAndOracle : public testing::TestWithParam<NamedView> {};

TEST_P(ReferenceAndOracle, DrawTheSamePicture) {
  const NamedView& v = GetParam();
  const std::filesystem::path file = std::filesystem::path(LMC_SOURCE_DIR) / v.file;
  // Samples are the project's own, and must be there; so must each asset where there are any.
  const std::filesystem::path assets = std::filesystem::path(LMC_SOURCE_DIR) / ".." / "shared" / "assets";
  if (std::string_view(v.file).starts_with("../shared/") && !std::filesystem::is_directory(assets))
    GTEST_SKIP() << "left out: no assets beside the project";
  const LoadedLevel loaded = loadForShader(file, v.camera, lmc::Run{});
  shaders::View view;
  view.camera = cameraFor(loaded.level.scene, v.camera);
  view.width = 256;
  view.height = 192;
  expectAgreement(loaded.level, loaded.maps, view, {Target::Diffuse, Target::Normal, Target::Picture});
}

INSTANTIATE_TEST_SUITE_P(Samples, ReferenceAndOracle,
                         testing::Values(NamedView{"cornell", "samples/cornell.glb", ""},
                                         NamedView{"two_rooms", "samples/two_rooms.glb", ""}, NamedView{"court", "samples/court.glb", ""},
                                         NamedView{"court_from_above", "samples/court.glb", "0,14,9,0,0,0,60"},
                                         NamedView{"curved", "samples/curved.glb", ""}, NamedView{"furnace", "samples/furnace.glb", ""},
                                         NamedView{"textured", "samples/textured.gltf", ""}),
                         [](const auto& i) { return std::string(i.param.name); });

INSTANTIATE_TEST_SUITE_P(
    Assets, ReferenceAndOracle,
    testing::Values(NamedView{"normal_tangent", "../shared/assets/NormalTangentTest/NormalTangentTest.glb", ""},
                    NamedView{"normal_tangent_mirror", "../shared/assets/NormalTangentMirrorTest/NormalTangentMirrorTest.glb", ""},
                    NamedView{"negative_scale", "../shared/assets/NegativeScaleTest/NegativeScaleTest.glb", ""},
                    NamedView{"lamp", "../shared/assets/LightsPunctualLamp/LightsPunctualLamp.gltf", ""},
                    NamedView{"texture_transforms", "../shared/assets/TextureTransformMultiTest/TextureTransformMultiTest.glb", ""},
                    NamedView{"alpha", "../shared/assets/AlphaBlendModeTest/AlphaBlendModeTest.glb", ""}),
    [](const auto& i) { return std::string(i.param.name); });

TEST(CheckScene, ReferenceAndOracleAgreeOnEveryTarget) {
  const shaders::CheckScene scene = shaders::checkScene();
  expectAgreement(scene.level, scene.maps, scene.view,
                  {Target::Diffuse, Target::Specular, Target::Normal, Target::Baked, Target::Emission, Target::AmbientLight,
                   Target::DiffuseLight, Target::SpecularLight, Target::Radiance, Target::Picture});
}

// A light's volume must light the same pixels from within as from without.
TEST(CheckScene, VolumesAreRightWithTheCameraInsideThem) {
  shaders::CheckScene scene = shaders::checkScene();
  for (const glm::dvec3& eye : {glm::dvec3(-1.8, 0.9, 2.2), glm::dvec3(-2.3, 1.6, 1.1), glm::dvec3(2.1, 1.6, 1.9)}) {
    scene.view.camera = shaders::cameraAt(eye, {0.0, -0.4, -0.6}, 1.2);
    expectAgreement(scene.level, scene.maps, scene.view, {Target::DiffuseLight, Target::SpecularLight, Target::Picture});
  }
}

TEST(CheckScene, ReferenceAndOracleAgreeWithoutTheLightMapAndWithReinhardsCurve) {
  shaders::CheckScene scene = shaders::checkScene();
  scene.view.lightMap = scene.view.bakedAo = scene.view.normalMaps = false;
  scene.view.toneCurve = shaders::ToneCurve::Reinhard;
  expectAgreement(scene.level, scene.maps, scene.view, {Target::Normal, Target::Radiance, Target::Picture});
}

// Baked light is in the map; what is left of its lamps is highlights, which dull walls have not.
TEST(Reference, DrawsNoPassForABakedLightThatAddsNothing) {
  LoadedLevel loaded = loadForShader(std::filesystem::path(LMC_SOURCE_DIR) / "samples" / "two_rooms.glb", "", lmc::Run{});
  ShadingLevel& level = loaded.level;
  std::ranges::fill(level.marked, std::uint8_t(1));
  for (ShadedLight& l : level.lights) l.baked = true;
  loaded.maps.illuminance.emplace_back(8, 8, Rgb(100.0f));
  shaders::View view;
  view.camera = cameraFor(level.scene, "");
  view.width = 64;
  view.height = 48;
  const Frame dull = shaders::Reference(level, loaded.maps).render(view);
  EXPECT_EQ(dull.lightsDrawn, 0);
  for (Material& m : level.scene.materials) m.shines = true;
  const Frame drawn = shaders::Reference(level, loaded.maps).render(view);
  EXPECT_EQ(drawn.lightsDrawn, int(level.lights.size()));
  EXPECT_EQ(dull[Target::Radiance].pixels, drawn[Target::Radiance].pixels);
  level.marked[0] = 0;
  for (Material& m : level.scene.materials) m.shines = false;
  EXPECT_GT(shaders::Reference(level, loaded.maps).render(view).lightsDrawn, 0) << "a surface without a map";
}

// Whether a place is hidden is yes or no, 1/32 each, and float and double differ where it is close: agreement is that of the mean.
TEST(CheckScene, ScreenSpaceOcclusionAgreesButForCloseCases) {
  shaders::CheckScene scene = shaders::checkScene();
  scene.view.screenAo = true;
  shaders::Reference reference(scene.level, scene.maps);
  const Frame gl = reference.render(scene.view), oracle = shaders::renderOracle(scene.level, scene.maps, scene.view, lmc::Run{});
  const Image<std::uint32_t> triangles = shaders::trianglesSeen(scene.level, scene.view);
  const test::Agreement a = test::agreement(gl[Target::ScreenAo], oracle[Target::ScreenAo], triangles, kOneOf255);
  EXPECT_GE(a.share(), 0.97) << a.text();
  double mean = 0.0, difference = 0.0;
  for (std::size_t i = 0; i < triangles.pixels.size(); ++i) {
    mean += double(gl[Target::ScreenAo].pixels[i].x) / double(triangles.pixels.size());
    difference += double(gl[Target::ScreenAo].pixels[i].x - oracle[Target::ScreenAo].pixels[i].x) / double(triangles.pixels.size());
  }
  EXPECT_LT(mean, 0.98) << "nothing is hidden";
  EXPECT_LT(std::abs(difference), 1e-3);
}

TEST(Oracle, DoesNotDependOnThreads) {
  const shaders::CheckScene scene = shaders::checkScene();
  lmc::Run one, three;
  one.threads = 1;
  three.threads = 3;
  Frame a, b;
  withThreads(one, [&] { a = shaders::renderOracle(scene.level, scene.maps, scene.view, one); });
  withThreads(three, [&] { b = shaders::renderOracle(scene.level, scene.maps, scene.view, three); });
  for (std::size_t t = 0; t < shaders::kTargetNames.size(); ++t) EXPECT_TRUE(a.targets[t].pixels == b.targets[t].pixels);
}

}  // namespace
}  // namespace lmc
