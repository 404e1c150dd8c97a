/// Each fault that people make, put into a copy of a shader, is found and named.
#include <gmock/gmock.h>

#include <unistd.h>

#include <fstream>

#include "libscene/files.h"
#include "shaders/check.h"

namespace lmc::shaders {
namespace {

namespace fs = std::filesystem;

struct Fault {
  const char *test, *file, *from, *to, *finding;
};
void PrintTo(const Fault& f, std::ostream* out) { *out << f.test; }

/// A folder of somebody's shaders, gone with its end.
struct Folder {
  fs::path path;
  explicit Folder(const std::string& name) : path(fs::path(testing::TempDir()) / ("lmc_faults_" + name + std::to_string(getpid()))) {
    fs::remove_all(path);
  }
  ~Folder() { fs::remove_all(path); }
  /// A copy of lmc's shader, `from` replaced, which must be in it.
  void put(const std::string& name, const std::string& from, const std::string& to) const {
    const auto bytes = readFile(fs::path(LMC_SOURCE_DIR) / "shaders" / name);
    std::string text(bytes.begin(), bytes.end());
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos) << name << " has no " << from;
    text.replace(at, from.size(), to);
    fs::create_directories((path / name).parent_path());
    std::ofstream(path / name) << text;
  }
};

ShaderCheck checkOnScene(const fs::path& folder) {
  const CheckScene scene = checkScene();
  const Stage stages[] = {{scene.level, scene.maps, scene.view}};
  return checkShaders(stages, folder, 1.0 / 255.0, lmc::Run{});
}

class Faults : public testing::TestWithParam<Fault> {};

TEST_P(Faults, AreFoundAndNamed) {
  const Fault& fault = GetParam();
  const Folder folder(fault.test);
  folder.put(fault.file, fault.from, fault.to);
  const ShaderCheck check = checkOnScene(folder.path);
  ASSERT_FALSE(check.passes.empty());
  bool named = false;
  for (const PassCheck& p : check.passes) {
    if (p.finding) {
      EXPECT_EQ(p.finding->name, fault.finding) << p.finding->words;
      named |= p.finding->name == fault.finding;
    } else {
      EXPECT_LE(p.largest(), 1.0 / 255.0) << kPasses[std::size_t(p.pass)].name << " differs without a name";
    }
  }
  EXPECT_TRUE(named);
}

const Fault kFaults[] = {
    {"MissingPi", "deferred/lightmap.frag", "s.illuminance * kInvPi", "s.illuminance", "pi"},
    {"PiTwice", "deferred/lightmap.frag", "s.illuminance * kInvPi", "s.illuminance * kInvPi * kInvPi", "pi"},
    {"MissingPiOfPointLights", "deferred/point.frag", "inverseSquare(distance) * kInvPi", "inverseSquare(distance)", "pi"},
    {"PiTwiceOfDirectionalLights", "deferred/directional.frag", "? kInvPi", "? kInvPi * kInvPi", "pi"},
    {"PiInverted", "deferred/spot.frag", "inverseSquare(distance) * kInvPi", "inverseSquare(distance) * kPi", "pi"},
    {"PiInTheComposite", "deferred/composite.frag", "vec4(s.albedo *", "vec4(kPi * s.albedo *", "pi"},
    {"PiTwiceInTheComposite", "deferred/composite.frag", "vec4(s.albedo *", "vec4(kInvPi * s.albedo *", "pi"},
    {"BaseDecodedTwice", "common/material.glsl", "{ return baseColorFactor * vertexColor * texture(baseColorTexture, uvOf(0)); }",
     "{\n  vec4 c = baseColorFactor * vertexColor * texture(baseColorTexture, uvOf(0));\n  return vec4(pow(c.rgb, vec3(2.2)), c.a);\n}",
     "gamma"},
    {"DecodedForEncoded", "deferred/tonemap.frag", "linearToSrgb(clamp(colour, 0.0, 1.0))", "pow(clamp(colour, 0.0, 1.0), vec3(2.2))",
     "gamma"},
    {"ExposureMissing", "deferred/tonemap.frag", "exposure * texel", "texel", "exposure-missing"},
    {"RedFlipped", "deferred/gbuffers_bump.frag", "colourToNormal(normalColour());", "colourToNormal(normalColour()) * vec3(-1, 1, 1);",
     "flipped-red"},
    {"TangentFlipped", "deferred/gbuffers_bump.frag", "normal.x * tangentWorld", "-normal.x * tangentWorld", "flipped-red"},
    {"NormalScaleIgnored", "deferred/gbuffers_bump.frag", "normal.xy *= normalScale;", "", "normal-scale-ignored"},
    {"MapScaleMissing", "common/material.glsl", "return lightMapScale * tex", "return tex", "light-map-scale-missing"},
    {"MapFlipped", "common/material.glsl", "texture(lightMap, mapUv)", "texture(lightMap, vec2(mapUv.x, 1.0 - mapUv.y))",
     "light-map-flipped"},
    {"HalfVector", "common/lighting.glsl", "dot(reflected, s.toCamera)", "dot(s.normal, normalize(toLight + s.toCamera))", "half-vector"},
    {"DiffuseAbsolute", "common/lighting.glsl", "saturate(dot(s.normal, toLight)) * att", "abs(dot(s.normal, toLight)) * att",
     "diffuse-unclamped"},
    {"AoOnDirectAlone", "deferred/composite.frag", "(ambient * ao + diffuse)", "(ambient + diffuse * ao)", "ao-on-direct"},
    {"MissingGamma", "deferred/tonemap.frag", "colour = linearToSrgb(clamp(colour, 0.0, 1.0))", "colour = clamp(colour, 0.0, 1.0)",
     "gamma"},
    {"GammaTwice", "deferred/tonemap.frag", "pictureTarget = vec4(colour", "pictureTarget = vec4(pow(colour, vec3(1.0 / 2.2))", "gamma"},
    {"RedAndBlueSwapped", "deferred/composite.frag", "vec4(s.albedo * (ambient * ao + diffuse) + specular + emitted",
     "vec4((s.albedo * (ambient * ao + diffuse) + specular + emitted).bgr", "swapped-red-blue"},
    {"DeterminantFlipped", "deferred/gbuffers_bump.vert", "* tangentMesh.w *", "* -tangentMesh.w *", "flipped-determinant"},
    {"CrossArgumentsSwapped", "deferred/gbuffers_bump.vert", "cross(normalWorld, tangentWorld)", "cross(tangentWorld, normalWorld)",
     "flipped-determinant"},
    {"DeterminantIgnored", "deferred/gbuffers_bump.vert", "* tangentMesh.w *", "*", "determinant-ignored"},
    {"NodeMirrorIgnored", "deferred/gbuffers_bump.vert", " * worldMirror;", ";", "node-mirror-ignored"},
    {"GreenFlipped", "deferred/gbuffers_bump.frag", "colourToNormal(normalColour());", "colourToNormal(normalColour()) * vec3(1, -1, 1);",
     "flipped-green"},
    {"NormalNotDecoded", "deferred/gbuffers_bump.frag", "colourToNormal(normalColour())", "normalColour()", "normal-not-decoded"},
    {"NormalByWorldMatrix", "deferred/gbuffers.vert", "normalMatrix * normalMesh", "mat3(world) * normalMesh", "normal-by-world-matrix"},
    {"BackNotTurned", "deferred/gbuffers.frag", "writeGBuffer(normalize(normalWorld))",
     "writeGBuffer(gl_FrontFacing ? normalize(normalWorld) : -normalize(normalWorld))", "back-not-turned"},
    {"GateMissing", "common/lighting.glsl", "if (!(dot(s.normal, toLight) > 0.0)) return vec3(0.0);", "", "missing-n.l-gate"},
    {"ReflectionSign", "common/lighting.glsl", "reflect(-toLight, s.normal)", "reflect(toLight, s.normal)", "reflection-sign"},
    {"ReflectArguments", "common/lighting.glsl", "reflect(-toLight, s.normal)", "reflect(s.normal, -toLight)", "reflect-arguments"},
    {"SpecularMapIgnored", "common/lighting.glsl", "return s.specular * light", "return light", "specular-map-ignored"},
    {"SpecularUnattenuated", "deferred/point.frag", "addLight(s, distance > 0.0 ? toLight / distance : vec3(0.0), attenuation);",
     "addLight(s, distance > 0.0 ? toLight / distance : vec3(0.0), attenuation);\n"
     "  specularLight = vec4(specularTerm(s, distance > 0.0 ? toLight / distance : vec3(0.0)), 0.0);",
     "specular-unattenuated"},
    {"DiffuseUnclamped", "common/lighting.glsl", "saturate(dot(s.normal, toLight)) * attenuation", "dot(s.normal, toLight) * attenuation",
     "diffuse-unclamped"},
    {"AttenuationRange", "common/attenuation.glsl", "lightAttenuation.z * distance * distance",
     "(1.0 / lightRange * lightRange) * distance * distance", "attenuation-range"},
    {"WindowMissing", "common/attenuation.glsl", "return denominator > 0.0 ? window", "return denominator > 0.0 ? 1.0",
     "range-window-missing"},
    {"WindowPowerOutside", "common/attenuation.glsl", "saturate(1.0 - pow(distance / lightRange, lightRangePower))",
     "pow(saturate(1.0 - distance / lightRange), lightRangePower)", "range-power-outside"},
    {"PhysicalWindowMissing", "common/attenuation.glsl", "? window / square", "? 1.0 / square", "range-window-missing"},
    {"InverseDistance", "common/attenuation.glsl", "return square > 0.0 ? window / square", "return square > 0.0 ? window / distance",
     "inverse-distance"},
    {"ConeNotSquared", "common/attenuation.glsl", "return s * s;", "return s;", "cone-not-squared"},
    {"ConeMissing", "deferred/spot.frag", " * spotCone(-dot(unit, lightDirection))", "", "cone-missing"},
    {"StaticTwice", "common/lighting.glsl", "lightBaked != 0 ? 1.0 - s.hasMap : 1.0", "1.0", "static-light-twice"},
    {"AoOnDirect", "deferred/composite.frag", "(ambient * ao + diffuse)", "(ambient + diffuse) * ao", "ao-on-direct"},
    {"AoIgnored", "deferred/composite.frag", "(ambient * ao + diffuse)", "(ambient + diffuse)", "ao-ignored"},
    {"AlbedoMissing", "deferred/composite.frag", "s.albedo * (ambient", "(ambient", "albedo-missing"},
    {"EmissionMissing", "deferred/composite.frag", " + emitted", "", "emission-missing"},
    {"UpsideDown", "deferred/tonemap.frag", "ivec2(gl_FragCoord.xy)", "ivec2(gl_FragCoord.x, 107.0 - floor(gl_FragCoord.y))",
     "upside-down"},
};

INSTANTIATE_TEST_SUITE_P(Each, Faults, testing::ValuesIn(kFaults), [](const auto& i) { return std::string(i.param.test); });

TEST(ShaderCheck, FindsNothingInCopiesOfItsOwnShaders) {
  const Folder folder("copies");
  for (const std::string_view name : shaderNames()) folder.put(std::string(name), "//", "// a copy:");
  const ShaderCheck check = checkOnScene(folder.path);
  EXPECT_EQ(check.passes.size(), kPasses.size());
  for (const PassCheck& p : check.passes) EXPECT_EQ(p.largest(), 0.0) << kPasses[std::size_t(p.pass)].name;
  EXPECT_EQ(check.picture.largest, 0.0);
}

TEST(ShaderCheck, SaysFileAndLineOfAnErrorEvenInAnInclude) {
  const Folder folder("broken");
  folder.put("common/lighting.glsl", "lightSpecularPower > 0.0", "lightSpecularPowr > 0.0");
  try {
    checkOnScene(folder.path);
    FAIL() << "it compiled";
  } catch (const Error& e) {
    EXPECT_EQ(e.kind, Exit::Broken);
    EXPECT_THAT(e.file, testing::EndsWith("common/lighting.glsl"));
    const auto bytes = readFile(folder.path / "common/lighting.glsl");
    const std::string text(bytes.begin(), bytes.end());
    const auto line = 1 + std::count(text.begin(), text.begin() + std::ptrdiff_t(text.find("lightSpecularPowr")), '\n');
    EXPECT_EQ(e.where, std::to_string(line)) << e.what();
    EXPECT_THAT(e.text, testing::HasSubstr("lightSpecularPowr"));
  }
}

TEST(ShaderCheck, RefusesIncludesThatAreNowhereOrGoRound) {
  const Folder folder("includes");
  folder.put("deferred/point.frag", "common/lighting.glsl", "common/lightning.glsl");
  EXPECT_THROW(shaderText("deferred/point.frag", folder.path), Error);
  folder.put("common/constants.glsl", "// Needs", "#include \"common/constants.glsl\"\n// Needs");
  EXPECT_THROW(shaderText("deferred/spot.frag", folder.path), Error);
}

}  // namespace
}  // namespace lmc::shaders
