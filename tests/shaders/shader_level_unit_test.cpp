/// What the shader is given of a level: tangents, maps, dynamic lights, the parts of classic lights, looks of materials.
#include <gmock/gmock.h>

#include "libscene/exr.h"
#include "libscene/image_file.h"
#include "lmc/shade_level.h"
#include "shaders/oracle.h"
#include "tests/libscene/gltf_files.h"

namespace lmc {
namespace {

using test::Builder;
using test::Folder;
using test::Json;

constexpr float kHalfRounding = 1.0f / 2048.0f;  // of values below 1, as halves keep them

/// A square level whose node has a place in a map.
Builder markedLevel() {
  Builder b = test::squareLevel();
  b.json["nodes"][0]["extras"]["lmc"]["lightmap"] = {{"uri", "lightmap.exr"}, {"scale", 1.0}, {"texCoord", 1}};
  return b;
}

void writeExrFile(const Folder& folder, const std::string& name, const std::vector<ExrChannel>& channels, float scale) {
  OutputSet set(folder.path());
  writeExr(set.open(name), 2, 2, channels, {{"lmcScale", scale}});
  set.commit();
}

/// A bake's folder by hand, with 2 x 2 texels. Without openness the ao.png in it is of an older bake: the sidecar does not name it. Its
/// ao.exr is dark, as where texels lie inside solids.
void writeBake(const Folder& folder, Builder level, bool withOpenness) {
  level.save(folder, "level.glb");
  const std::vector<float> e{0.5f, 1.0f, 1.5f, 2.0f}, dark(4, 0.0f);
  Image<glm::u8vec4> openness(2, 2);
  for (std::size_t i = 0; i < 4; ++i) openness.pixels[i] = glm::u8vec4(glm::u8vec3(51 * (i + 1)), 255);
  writeExrFile(folder, "lightmap.exr", {{"R", e.data()}, {"G", e.data()}, {"B", e.data()}}, 4.0f);
  writeExrFile(folder, "ao.exr", {{"Y", dark.data()}}, 1.0f);
  const std::vector<std::uint8_t> png = encodePng(openness, false);
  folder.write("ao.png", std::string(png.begin(), png.end()));
  Json sidecar{{"maps", {{{"file", "lightmap.exr"}}}}};
  if (withOpenness) sidecar["maps"][0].update({{"ao", "ao.exr"}, {"ao_picture", "ao.png"}});
  for (const char* name : {"level.glb", "lightmap.exr"})
    sidecar["files"].push_back({{"name", name}, {"xxh3", contentHash(readFile(folder.path() / name))}});
  folder.write("level.lmc.json", sidecar.dump());
}

/// The square from in front, so that texel centres lie a quarter of the picture from its borders.
shaders::View squareView(const Scene& scene) {
  shaders::View view;
  view.camera =
      shaders::cameraAt(glm::dvec3(0.5, 0.5, 1.0) - scene.centre_m, glm::dvec3(0.5, 0.5, 0.0) - scene.centre_m, 2.0 * std::atan(0.5));
  view.width = view.height = 2;
  view.exposure = 1.0;
  return view;
}

TEST(ShaderLevel, MapsOfABakeAreReadWithTheirScaleAndSampledByMapUvs) {
  const Folder folder;
  writeBake(folder, markedLevel(), true);
  const LoadedLevel loaded = loadForShader(folder.path(), "", lmc::Run{});
  const shaders::Frame frame = shaders::renderOracle(loaded.level, loaded.maps, squareView(loaded.level.scene), lmc::Run{});
  // The square's V runs upwards with y; the map's rows run down with V.
  EXPECT_NEAR(frame[shaders::Target::Baked].at(0, 1).x, 4.0f * 0.5f, 4.0f * kHalfRounding);
  EXPECT_NEAR(frame[shaders::Target::Baked].at(1, 0).x, 4.0f * 2.0f, 8.0f * kHalfRounding);
  EXPECT_NEAR(frame[shaders::Target::Diffuse].at(0, 1).w, 0.2f, kHalfRounding);
  EXPECT_NEAR(frame[shaders::Target::Diffuse].at(1, 0).w, 0.8f, kHalfRounding);
  EXPECT_NEAR(frame[shaders::Target::DiffuseLight].at(1, 0).x, 8.0f / 3.14159265f, 8.0f * kHalfRounding);
}

TEST(ShaderLevel, WithoutAnAoMapOpennessIsThatOfTheMaterial) {
  const Folder folder;
  writeBake(folder, markedLevel(), false);
  const LoadedLevel loaded = loadForShader(folder.path(), "", lmc::Run{});
  EXPECT_TRUE(loaded.maps.openness.empty());
  const shaders::Frame frame = shaders::renderOracle(loaded.level, loaded.maps, squareView(loaded.level.scene), lmc::Run{});
  EXPECT_EQ(frame[shaders::Target::Diffuse].at(0, 0).w, 1.0f);
}

TEST(ShaderLevel, AMapThatTheSidecarLacksOrAFileThatIsAnotherIsRefused) {
  const Folder folder;
  Builder level = markedLevel();
  level.json["nodes"][0]["extras"]["lmc"]["lightmap"]["map"] = 3;
  writeBake(folder, level, false);
  EXPECT_THROW(loadForShader(folder.path(), "", lmc::Run{}), Error);
  writeBake(folder, markedLevel(), false);
  folder.write("lightmap.exr", "other bytes");
  EXPECT_THROW(loadForShader(folder.path(), "", lmc::Run{}), Error);
}

Builder levelWithLights() {
  Builder b = test::squareLevel();
  b.json["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"},
                                                            {"intensity", 3.0},
                                                            {"extras",
                                                             {{"lmc",
                                                               {{"model", "classic"},
                                                                {"ambient", {0.1, 0.2, 0.3}},
                                                                {"specular", {1.0, 0.5, 0.25}},
                                                                {"specularIntensity", 0.5},
                                                                {"attenuation", {{"range", 4.0}}}}}}}},
                                                           {{"type", "directional"}, {"intensity", 2.0}}};
  for (const int light : {0, 1}) {
    b.json["nodes"].push_back({{"extensions", {{"KHR_lights_punctual", {{"light", light}}}}}});
    b.json["scenes"][0]["nodes"].push_back(light + 1);
  }
  return b;
}

TEST(ShaderLevel, ClassicLightsHaveTheirPartsAndAQuadraticFactorOfOneOverTheProduct) {
  const Folder folder;
  const LoadedLevel loaded = loadForShader(levelWithLights().save(folder), "", lmc::Run{});
  ASSERT_EQ(loaded.level.lights.size(), 2u);
  const ShadedLight &classic = loaded.level.lights[0], &sun = loaded.level.lights[1];
  EXPECT_EQ(classic.ambient, Rgb(0.1f, 0.2f, 0.3f));
  EXPECT_EQ(classic.specular, Rgb(1.0f, 0.5f, 0.25f));
  EXPECT_EQ(classic.light.intensity, Rgb(3.0f));
  EXPECT_EQ(classic.specularIntensity, 0.5);
  EXPECT_EQ(classic.specularPower, 32.0);
  EXPECT_EQ(classic.light.classic->linear, 2.0 / 4.0);
  EXPECT_EQ(classic.light.classic->quadratic, 1.0 / 16.0);
  EXPECT_EQ(sun.ambient, Rgb(0.0f));
  EXPECT_EQ(sun.specular, Rgb(2.0f));
  EXPECT_EQ(sun.specularPower, 0.0);
}

TEST(ShaderLevel, DynamicLightsAreDrawnAndMarksOfABakeAreKept) {
  const Folder folder;
  Builder level = levelWithLights();
  level.json["nodes"][1]["extras"]["lmc"]["static"] = false;
  level.json["nodes"][1]["extras"]["lmc"]["baked"] = true;  // cannot be: it is dynamic
  level.json["nodes"][2]["extras"]["lmc"]["baked"] = true;
  const LoadedLevel loaded = loadForShader(level.save(folder), "", lmc::Run{});
  ASSERT_EQ(loaded.level.lights.size(), 2u);
  EXPECT_FALSE(loaded.level.lights[0].baked);
  EXPECT_TRUE(loaded.level.lights[1].baked);
  EXPECT_EQ(loaded.level.scene.lights.size(), 1u);
}

TEST(ShaderLevel, DynamicMeshesAreDrawnWithoutALightMap) {
  const Folder folder;
  Builder level = markedLevel();
  level.json["nodes"].push_back({{"mesh", 0}, {"translation", {0, 0, -1}}, {"extras", {{"lmc", {{"static", false}}}}}});
  level.json["scenes"][0]["nodes"].push_back(1);
  const LoadedLevel loaded = loadForShader(level.save(folder), "", lmc::Run{});
  ASSERT_EQ(loaded.level.scene.objects.size(), 2u);
  EXPECT_TRUE(loaded.level.marked[0]);
  EXPECT_FALSE(loaded.level.marked[1]);
}

// A level whose every mesh moves is baked at rest, its moving lights with it: they must not be drawn twice.
TEST(ShaderLevel, LightsOfALevelBakedAtRestPoseCountAsBaked) {
  const Folder folder;
  Builder level = levelWithLights();
  const int times = level.add<float>({0.0f, 1.0f}, "SCALAR", 1), moves = level.add<float>({0, 0, 0, 1, 0, 0}, "VEC3", 3);
  level.json["animations"] = {{{"samplers", {{{"input", times}, {"output", moves}}}}, {"channels", Json::array()}}};
  for (const int node : {0, 2})
    level.json["animations"][0]["channels"].push_back({{"sampler", 0}, {"target", {{"node", node}, {"path", "translation"}}}});
  level.json["nodes"][2]["extras"]["lmc"]["baked"] = true;
  const LoadedLevel loaded = loadForShader(level.save(folder), "", lmc::Run{});
  ASSERT_EQ(loaded.level.lights.size(), 2u);
  EXPECT_TRUE(loaded.level.lights[1].baked);
  EXPECT_EQ(loaded.level.scene.objects.size(), 1u);
}

/// A normal map of one texel, 4 x 4 pixels of PNG in the buffer.
Builder bumpyLevel() {
  Builder b = test::squareLevel();
  b.json["images"] = {{{"uri", "flat.png"}}};
  b.json["textures"] = {{{"source", 0}}};
  b.json["materials"][0]["normalTexture"] = {{"index", 0}, {"scale", 0.5}};
  return b;
}

void writeFlatPicture(const Folder& folder) {
  const std::vector<std::uint8_t> png = encodePng(Image<glm::u8vec4>(4, 4, {128, 128, 255, 255}), false);
  folder.write("flat.png", std::string(png.begin(), png.end()));
}

TEST(ShaderLevel, MissingTangentsAreMadeAndAMirroredNodeChangesNothingInTheSpaceOfTheMesh) {
  const Folder folder;
  writeFlatPicture(folder);
  for (const double side : {1.0, -1.0}) {
    Builder level = bumpyLevel();
    level.json["nodes"][0]["scale"] = {side, 1.0, 1.0};
    const LoadedLevel loaded = loadForShader(level.save(folder), "", lmc::Run{});
    const Object& o = loaded.level.scene.objects[0];
    EXPECT_EQ(o.mirrored, side < 0.0);
    EXPECT_EQ(loaded.level.looks[o.material].normalScale, 0.5f);
    for (std::uint32_t v = o.firstVertex; v < o.firstVertex + o.vertexCount; ++v) {
      // U runs with x, V with y: green points against V, down, so that cross(normal, tangent) = +y has determinant -1.
      EXPECT_EQ(loaded.level.tangents[v], glm::vec4(1, 0, 0, -1));
    }
    EXPECT_EQ(loaded.level.worlds.size(), 1u);
  }
}

TEST(ShaderLevel, LooksOfMaterialsFollowExtrasAndKhrSpecular) {
  const Folder folder;
  writeFlatPicture(folder);
  Builder level = bumpyLevel();
  Json plain = level.json["materials"][0], khr = plain, own = plain;
  khr["extensions"]["KHR_materials_specular"] = {{"specularFactor", 0.5}, {"specularColorFactor", {1.0, 0.5, 2.0}}};
  own["extras"]["lmc"] = {{"specularTexture", {{"index", 0}}}, {"objectSpaceNormals", true}};
  level.json["materials"] = {plain, khr, own};
  for (const int material : {1, 2}) {
    Json primitive = level.json["meshes"][0]["primitives"][0];
    primitive["material"] = material;
    level.json["meshes"][0]["primitives"].push_back(primitive);
  }
  const LoadedLevel loaded = loadForShader(level.save(folder), "", lmc::Run{});
  const std::vector<Look>& looks = loaded.level.looks;
  EXPECT_EQ(looks[0].specular, Rgb(0.04f));
  EXPECT_TRUE(looks[0].dullByRoughness);
  EXPECT_EQ(looks[1].specular, 0.04f * 0.5f * Rgb(1.0f, 0.5f, 2.0f));
  EXPECT_EQ(looks[2].specular, Rgb(1.0f));
  EXPECT_TRUE(looks[2].specularTexture);
  EXPECT_FALSE(looks[2].dullByRoughness);
  EXPECT_TRUE(looks[2].objectSpaceNormals);
  level.json["materials"][2]["extras"]["lmc"]["specularTexture"]["index"] = 7;
  EXPECT_THROW(loadForShader(level.save(folder), "", lmc::Run{}), Error);
}

TEST(ShaderCamera, IsFoundByNameOrByNumbersInTheLevelsOwnCoordinates) {
  const Scene scene = loadLevel(std::filesystem::path(LMC_SOURCE_DIR) / "samples/curved.glb", {}, lmc::Run{});
  EXPECT_EQ(cameraFor(scene, "ball").name, "ball");
  EXPECT_EQ(cameraFor(scene, "").name, scene.cameras[0].name);
  const Camera c = cameraFor(scene, "1,2,3,1,2,0,90");
  EXPECT_LT(glm::length(c.position_m + scene.centre_m - glm::dvec3(1, 2, 3)), 1e-12);
  EXPECT_LT(glm::length(c.axes[2] - glm::dvec3(0, 0, 1)), 1e-12);
  for (const char* wrong : {"nobody", "1,2,3,1,2,0", "1,2,3,1,2,0,90,", "1,2,3,1,2,3,90", "1,2,3,1,2,0,180", "1,2,3,1,2,nan,60"})
    EXPECT_THROW(cameraFor(scene, wrong), Error) << wrong;
}

}  // namespace
}  // namespace lmc
