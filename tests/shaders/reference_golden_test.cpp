/// The GLSL reference against the oracle: two renderers that share no formula, one in GL's single precision, one in C++'s double.
#include <gmock/gmock.h>

#include <cstdlib>

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

struct NamedView {
  const char *name, *file, *camera;
  double exposure;
};

void PrintTo(const NamedView& v, std::ostream* out) { *out << v.name; }

std::filesystem::path fileOf(const NamedView& v) { return std::filesystem::path(LMC_SOURCE_DIR) / v.file; }

void expectAgreement(const ShadingLevel& level, const shaders::LevelMaps& maps, const shaders::View& view) {
  shaders::Reference reference(level, maps);
  const Frame gl = reference.render(view), oracle = shaders::renderOracle(level, maps, view, lmc::Run{});
  const Image<std::uint32_t> triangles = shaders::trianglesSeen(level, view);
  const auto surfaces = std::ranges::count_if(triangles.pixels, [](std::uint32_t t) { return t != kNone; });
  EXPECT_GT(surfaces, std::ptrdiff_t(triangles.pixels.size() / 10)) << "the camera sees next to nothing";
  for (const Target t : {Target::Diffuse, Target::Normal, Target::Picture}) {
    const test::Agreement a = test::agreement(gl[t], oracle[t], triangles, kOneOf255);
    std::printf("  %-8s %s\n", std::string(shaders::kTargetNames[std::size_t(t)]).c_str(), a.text().c_str());
    EXPECT_GE(a.share(), kShareThatAgrees) << a.text();
    EXPECT_EQ(a.insideFaces, 0u) << a.text();
  }
}

class ReferenceAndOracle : public testing::TestWithParam<NamedView> {};

TEST_P(ReferenceAndOracle, DrawTheSamePicture) {
  const NamedView& v = GetParam();
  if (!std::filesystem::exists(fileOf(v))) GTEST_SKIP() << "left out: " << v.file << " is not beside the project";
  const LoadedLevel loaded = loadForShader(fileOf(v), v.camera, lmc::Run{});
  shaders::View view;
  view.camera = cameraFor(loaded.level.scene, v.camera);
  view.width = 256;
  view.height = 192;
  view.exposure = v.exposure;
  expectAgreement(loaded.level, loaded.maps, view);
}

INSTANTIATE_TEST_SUITE_P(
    Views, ReferenceAndOracle,
    testing::Values(NamedView{"cornell", "samples/cornell.glb", "", 0.5}, NamedView{"two_rooms", "samples/two_rooms.glb", "", 0.3},
                    NamedView{"court", "samples/court.glb", "", 0.3}, NamedView{"curved", "samples/curved.glb", "", 0.3},
                    NamedView{"furnace", "samples/furnace.glb", "", 0.3}, NamedView{"textured", "samples/textured.gltf", "", 0.3},
                    NamedView{"normal_tangent", "../shared/assets/NormalTangentTest/NormalTangentTest.glb", "", 1.0},
                    NamedView{"normal_tangent_mirror", "../shared/assets/NormalTangentMirrorTest/NormalTangentMirrorTest.glb", "", 1.0},
                    NamedView{"negative_scale", "../shared/assets/NegativeScaleTest/NegativeScaleTest.glb", "", 1.0},
                    NamedView{"lamp", "../shared/assets/LightsPunctualLamp/LightsPunctualLamp.gltf", "", 0.05},
                    NamedView{"texture_transforms", "../shared/assets/TextureTransformMultiTest/TextureTransformMultiTest.glb", "", 1.0},
                    NamedView{"alpha", "../shared/assets/AlphaBlendModeTest/AlphaBlendModeTest.glb", "", 1.0}),
    [](const auto& i) { return std::string(i.param.name); });

TEST(ReferenceAndOracleOnTheCheckScene, DrawTheSameLightAndGBuffer) {
  const shaders::CheckScene scene = shaders::checkScene();
  expectAgreement(scene.level, scene.maps, scene.view);
}

}  // namespace
}  // namespace lmc
