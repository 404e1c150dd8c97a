#include "libscene/level.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>
#include <numbers>

#include "tests/libscene/gltf_files.h"

namespace lmc::test {
namespace {

constexpr float kUlps = 1e-6f;  // a few steps of a float near 1

glm::vec3 faceNormal(const Scene& scene, std::uint32_t triangle) {
  const auto c = scene.corners_m(triangle);
  return glm::vec3(glm::normalize(glm::cross(c[1] - c[0], c[2] - c[0])));
}

TEST(Level, ASquareComesOutAsItIs) {
  Folder folder;
  Heard heard;
  Builder b = squareLevel();
  b.json["nodes"][0]["name"] = "floor";
  const auto file = b.save(folder);
  const Scene scene = loadLevel(file, {}, heard.run);
  EXPECT_EQ(heard.warnings(), 0u);
  EXPECT_EQ(scene.triangles.size(), 2u);
  EXPECT_EQ(scene.positions_m.size(), 4u);
  EXPECT_EQ(scene.centre_m, glm::dvec3(0.5, 0.5, 0.0));
  EXPECT_EQ(scene.extent_m, 0.5f);
  ASSERT_EQ(scene.objects.size(), 1u);
  EXPECT_EQ(scene.objects[0].path, "/floor");
  EXPECT_TRUE(scene.objects[0].inMap);
  EXPECT_EQ(scene.inputs, (std::vector<std::filesystem::path>{file, folder.path() / "level.bin"}));
  EXPECT_TRUE(heard.noted("LMC_NO_LIGHT"));
}

TEST(Level, MirroredNodesKeepTheirFrontInFront) {
  Folder folder;
  Builder b = squareLevel();
  b.json["nodes"][0]["scale"] = {-1, 1, 1};
  const Scene scene = load(b.save(folder));
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) EXPECT_EQ(faceNormal(scene, t), glm::vec3(0, 0, 1));
  for (const glm::vec3& n : scene.normals) EXPECT_EQ(n, glm::vec3(0, 0, 1));
}

TEST(Level, NormalsOfAMirroredAndUnevenlyScaledNodeFollowTheFaces) {
  Folder folder;
  Builder b = squareLevel();
  const double s = std::sin(0.4), c = std::cos(0.4);
  b.json["nodes"] = {{{"scale", {-3, 1, 0.5}}, {"children", {1}}}, {{"mesh", 0}, {"rotation", {s, 0, 0, c}}}};
  const Scene scene = load(b.save(folder));
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t)
    EXPECT_LT(glm::distance(faceNormal(scene, t), scene.normals[scene.triangles[t].x]), kUlps);
}

TEST(Level, TransformsMultiplyDownTheTreeAsMatrixOrTrs) {
  Folder folder;
  Builder b = squareLevel();
  const double half = std::numbers::sqrt2 / 2;
  b.json["nodes"] = {{{"matrix", {2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 10, 0, 0, 1}}, {"children", {1}}},
                     {{"mesh", 0}, {"translation", {0, 1, 0}}, {"rotation", {0, 0, half, half}}}};  // a quarter turn about z
  const Scene scene = load(b.save(folder));
  // (1, 0, 0) -> (0, 1, 0) -> (0, 2, 0) -> (10, 4, 0)
  EXPECT_LT(glm::distance(glm::dvec3(scene.positions_m[1]) + scene.centre_m, glm::dvec3(10, 4, 0)), kUlps);
}

TEST(Level, FarFromTheOriginNothingIsRounded) {
  Folder folder;
  Builder b = squareLevel();
  b.json["nodes"][0]["translation"] = {1.0e7, 0, -3.0e6};
  const Scene scene = load(b.save(folder));
  EXPECT_EQ(scene.positions_m[2], glm::vec3(0.5f, 0.5f, 0.0f));
  EXPECT_EQ(scene.centre_m, glm::dvec3(1.0e7 + 0.5, 0.5, -3.0e6));
}

TEST(Level, TenThousandNestedNodesNeedNoStack) {
  Folder folder;
  Builder b = squareLevel();
  b.json["nodes"] = Json::array();
  for (int n = 0; n < 10000; ++n) b.json["nodes"].push_back({{"name", "n"}, {"translation", {0, 0, 1}}, {"children", {n + 1}}});
  b.json["nodes"].push_back({{"mesh", 0}});
  const Scene scene = load(b.save(folder));
  EXPECT_EQ(scene.centre_m.z, 10000.0);
  EXPECT_LT(scene.objects[0].path.size(), 2000u);
}

TEST(Level, MissingNormalsAreThoseOfTheFaces) {
  Folder folder;
  Builder b = squareLevel();
  b.json["meshes"][0]["primitives"][0]["attributes"].erase("NORMAL");
  const Scene scene = load(b.save(folder));
  EXPECT_EQ(scene.positions_m.size(), 6u);
  for (const glm::vec3& n : scene.normals) EXPECT_EQ(n, glm::vec3(0, 0, 1));
}

TEST(Level, ZeroNormalsAreRebuiltAndSaid) {
  Folder folder;
  Heard heard;
  Builder b = squareLevel();
  b.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = b.add<float>({0, 0, 0, 0, 0, 1, NAN, 0, 0, 0, 0, 5}, "VEC3", 3);
  const Scene scene = loadLevel(b.save(folder), {}, heard.run);
  for (const glm::vec3& n : scene.normals) EXPECT_LT(glm::distance(n, glm::vec3(0, 0, 1)), kUlps);
  EXPECT_TRUE(heard.warned("LMC_NORMAL_ZERO"));
  EXPECT_TRUE(heard.noted("LMC_NORMAL_NOT_UNIT"));
}

TEST(Level, StripsAndFansHaveTheirFrontsWhereListsHaveThem) {
  for (const int mode : {5, 6}) {
    Folder folder;
    Builder b = squareLevel();
    auto& primitive = b.json["meshes"][0]["primitives"][0];
    primitive["mode"] = mode;
    primitive["indices"] = mode == 5 ? b.add<std::uint8_t>({0, 1, 3, 2}, "SCALAR", 1) : b.add<std::uint8_t>({0, 1, 2, 3}, "SCALAR", 1);
    const Scene scene = load(b.save(folder));
    ASSERT_EQ(scene.triangles.size(), 2u) << mode;
    for (std::uint32_t t = 0; t < 2; ++t) EXPECT_EQ(faceNormal(scene, t), glm::vec3(0, 0, 1)) << mode;
  }
}

TEST(Level, SparseAccessorsReplaceElementsOfAViewOrOfZeros) {
  for (const bool withView : {true, false}) {
    Folder folder;
    Builder b = squareLevel();
    const int indices = b.add<std::uint16_t>({1, 2, 3}, "SCALAR", 1);
    const int values = b.add<float>({4, 0, 0, 4, 4, 0, 0, 4, 0}, "VEC3", 3);
    auto& positions = b.json["accessors"][0];
    positions["sparse"] = {{"count", 3},
                           {"indices", {{"bufferView", b.json["accessors"][indices]["bufferView"]}, {"componentType", 5123}}},
                           {"values", {{"bufferView", b.json["accessors"][values]["bufferView"]}}}};
    if (!withView) positions.erase("bufferView");
    EXPECT_EQ(load(b.save(folder)).extent_m, 2.0f);
  }
}

TEST(Level, QuantizedValuesAreScaledAsTheSpecificationSays) {
  Folder folder;
  Builder b = squareLevel();
  b.json["extensionsUsed"] = b.json["extensionsRequired"] = {"KHR_mesh_quantization"};
  const int normals = b.add<std::int8_t>({0, 0, 127, 0, -128, 0, 0, 0, 0, 0, 127, 0, 0, 0, 127, 0}, "VEC3", 4);
  b.json["bufferViews"].back()["byteStride"] = 4;
  b.json["accessors"].back()["normalized"] = true;
  b.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = normals;
  const Scene scene = load(b.save(folder));
  EXPECT_EQ(scene.normals[0], glm::vec3(0, 0, 1));
  EXPECT_EQ(scene.normals[1], glm::vec3(-1, 0, 0));  // -128 is clamped to -1
}

TEST(Level, GpuInstancesAreObjectsOfTheirOwn) {
  Folder folder;
  Builder b = squareLevel();
  b.json["extensionsUsed"] = {"EXT_mesh_gpu_instancing"};
  b.json["nodes"][0]["name"] = "column";
  b.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["TRANSLATION"] = b.add<float>({0, 0, 0, 9, 0, 0}, "VEC3", 3);
  const Scene scene = load(b.save(folder));
  ASSERT_EQ(scene.objects.size(), 2u);
  EXPECT_EQ(scene.objects[1].path, "/column[1]");
  EXPECT_EQ(scene.extent_m, 5.0f);
}

TEST(Level, PathsAreUnique) {
  Folder folder;
  Builder b = squareLevel();
  b.json["scenes"][0]["nodes"] = {0, 1};
  b.json["nodes"] = {{{"name", "box"}, {"mesh", 0}}, {{"name", "box"}, {"mesh", 0}, {"translation", {2, 0, 0}}}};
  const Scene scene = load(b.save(folder));
  EXPECT_EQ(scene.objects[0].path, "/box");
  EXPECT_EQ(scene.objects[1].path, "/box[node 1]");
}

TEST(Level, ExtrasAreInheritedDownTheTree) {
  Folder folder;
  Builder b = squareLevel();
  b.json["scenes"][0]["extras"]["lmc"] = {{"sky", {{"radiance", {1, 2, 3}}}},
                                          {"lightmap", {{"resolution", 256}, {"texels_per_metre", 8.5}}}};
  b.json["nodes"] = {{{"children", {1, 2, 3}}, {"extras", {{"lmc", {{"cast", false}, {"texelsPerMetre", 4}}}}}},
                     {{"mesh", 0}},
                     {{"mesh", 0}, {"extras", {{"lmc", {{"cast", true}, {"receive", false}}}}}},
                     {{"mesh", 0}, {"extras", {{"lmc", {{"static", false}}}}}}};
  const Scene scene = load(b.save(folder));
  ASSERT_EQ(scene.objects.size(), 2u);
  EXPECT_FALSE(scene.objects[0].cast);
  EXPECT_EQ(scene.objects[0].texelsPerMetre, 4.0);
  EXPECT_TRUE(scene.objects[1].cast);
  EXPECT_FALSE(scene.objects[1].receive);
  EXPECT_EQ(scene.dynamicMeshNodes, 1u);
  EXPECT_EQ(scene.sky, Rgb(1, 2, 3));
  EXPECT_EQ(scene.mapResolution, 256);
  EXPECT_EQ(scene.texelsPerMetre, 8.5);
}

TEST(Level, AnimatedNodesAreDynamicUnlessThereIsNothingElse) {
  Folder folder;
  Heard heard;
  Builder b = squareLevel();
  b.json["scenes"][0]["nodes"] = {0, 1};
  b.json["nodes"] = {{{"children", {2}}}, {{"mesh", 0}}, {{"mesh", 0}}};
  b.json["animations"] = {
      {{"channels", {{{"sampler", 0}, {"target", {{"node", 0}, {"path", "translation"}}}}}}, {"samplers", Json::array()}}};
  EXPECT_EQ(load(b.save(folder)).objects.size(), 1u);
  b.json["scenes"][0]["nodes"] = {0};
  const Scene atRest = loadLevel(b.save(folder), {}, heard.run);
  EXPECT_EQ(atRest.objects.size(), 1u);
  EXPECT_EQ(heard.warnings(), 1u);
  EXPECT_TRUE(heard.warned("LMC_DEFORMABLE"));
}

Builder lightLevel(const Json& light) {
  Builder b = squareLevel();
  b.json["extensionsUsed"] = {"KHR_lights_punctual"};
  b.json["extensions"]["KHR_lights_punctual"]["lights"] = {light};
  b.json["scenes"][0]["nodes"] = {0, 1};
  b.json["nodes"].push_back({{"name", "lamp"}, {"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}});
  return b;
}

TEST(Level, LightsStandAndPointAsTheirNode) {
  Folder folder;
  Builder b = lightLevel({{"type", "spot"}, {"color", {1, 0.5, 0}}, {"intensity", 8}, {"range", 6}, {"spot", Json::object()}});
  const double half = std::numbers::sqrt2 / 2;
  b.json["nodes"][1]["translation"] = {0, 5, 0};
  b.json["nodes"][1]["scale"] = {3, 3, 3};
  b.json["nodes"][1]["rotation"] = {-half, 0, 0, half};  // -z to -y
  const Scene scene = load(b.save(folder));
  ASSERT_EQ(scene.lights.size(), 1u);
  const Light& light = scene.lights[0];
  EXPECT_EQ(light.path, "/lamp");
  EXPECT_EQ(light.position_m + scene.centre_m, glm::dvec3(0, 5, 0));
  EXPECT_LT(glm::distance(light.direction, glm::dvec3(0, -1, 0)), kUlps);
  EXPECT_EQ(light.intensity, Rgb(8, 4, 0));
  EXPECT_EQ(light.range_m, 6.0);
  EXPECT_EQ(light.cosInner, 1.0);
  EXPECT_NEAR(light.cosOuter, half, 1e-15);
}

TEST(Level, AClassicLightWithARangeAloneGetsTheSuggestedAttenuation) {
  Folder folder;
  Json light = {{"type", "point"}, {"color", {1, 1, 0.5}}, {"intensity", 2}};
  light["extras"]["lmc"] = {{"model", "classic"}, {"attenuation", {{"range", 4}}}};
  const Scene scene = load(lightLevel(light).save(folder));
  ASSERT_TRUE(scene.lights.at(0).classic);
  const ClassicAttenuation& a = *scene.lights[0].classic;
  EXPECT_EQ(a.constant, 1.0);
  EXPECT_EQ(a.linear, 0.5);
  EXPECT_EQ(a.quadratic, 1.0 / 16);
  EXPECT_EQ(a.power, 2.0);
  EXPECT_EQ(scene.lights[0].intensity, Rgb(2, 2, 1));
}

TEST(Level, ALightOfADynamicNodeIsCountedNotBaked) {
  Folder folder;
  Builder b = lightLevel({{"type", "point"}});
  b.json["nodes"][1]["extras"]["lmc"]["static"] = false;
  const Scene scene = load(b.save(folder));
  EXPECT_TRUE(scene.lights.empty());
  EXPECT_EQ(scene.dynamicLights, 1u);
}

TEST(Level, MaterialsKeepWhatDecidesAboutDiffuseLight) {
  Folder folder;
  Builder b = squareLevel();
  b.json["extensionsUsed"] = {"KHR_materials_emissive_strength", "KHR_materials_transmission"};
  b.json["materials"][0] = {
      {"emissiveFactor", {1, 0.5, 0}},
      {"alphaMode", "MASK"},
      {"alphaCutoff", 0.25},
      {"doubleSided", true},
      {"extensions",
       {{"KHR_materials_emissive_strength", {{"emissiveStrength", 10}}}, {"KHR_materials_transmission", {{"transmissionFactor", 0.5}}}}}};
  const Material m = load(b.save(folder)).materials[0];
  EXPECT_EQ(m.emission, Rgb(10, 5, 0));
  EXPECT_EQ(m.alpha, Material::Alpha::Mask);
  EXPECT_EQ(m.alphaCutoff, 0.25f);
  EXPECT_TRUE(m.doubleSided);
  EXPECT_TRUE(m.transmissive);
  EXPECT_EQ(m.metallic, 1.0f);
}

TEST(Level, MaterialsShineWhereTheShadersGiveThemHighlights) {
  using Json = nlohmann::json;
  const auto shines = [](const Json& pbr, const Json& more = Json::object()) {
    Folder folder;
    Builder b = squareLevel();
    b.json["extensionsUsed"] = {"KHR_materials_specular"};
    b.json["materials"][0] = {{"pbrMetallicRoughness", pbr}};
    b.json["materials"][0].update(more);
    return load(b.save(folder)).materials[0].shines;
  };
  const Json rough = {{"metallicFactor", 0}}, smooth = {{"metallicFactor", 0}, {"roughnessFactor", 0.5}};
  EXPECT_FALSE(shines(rough));
  EXPECT_TRUE(shines(smooth));
  EXPECT_TRUE(shines(Json::object())) << "metallicFactor is 1 where it is not said";
  EXPECT_FALSE(shines(smooth, {{"extensions", {{"KHR_materials_specular", {{"specularFactor", 0}}}}}}));
}

TEST(Level, ALevelWithoutTrianglesIsEmptyAndSaysSo) {
  Folder folder;
  Heard heard;
  EXPECT_TRUE(loadLevel(folder.write("a.gltf", R"({"asset":{"version":"2.0"}})"), {}, heard.run).triangles.empty());
  EXPECT_TRUE(heard.warned("LMC_NOTHING_TO_BAKE"));
}

TEST(Level, DegenerateTrianglesAreLeftOut) {
  Folder folder;
  Builder b = squareLevel();
  b.json["meshes"][0]["primitives"][0]["indices"] = b.add<std::uint16_t>({0, 1, 2, 1, 1, 2}, "SCALAR", 1);
  EXPECT_EQ(load(b.save(folder)).triangles.size(), 1u);
}

TEST(Level, OneThatIsNotThereIsNoBrokenOne) {
  Folder folder;
  EXPECT_EQ(errorOf(folder.path() / "none.glb").kind, Exit::Io);
  EXPECT_EQ(errorOf(folder.path()).kind, Exit::Io);
  Builder b = squareLevel();
  const auto file = b.save(folder);
  std::filesystem::remove(folder.path() / "level.bin");
  const Error e = errorOf(file);
  EXPECT_EQ(e.kind, Exit::Io);
  EXPECT_EQ(e.where, "/buffers/0/uri");
}

TEST(Level, NothingOutsideOfItsFolderIsRead) {
  Folder folder;
  Builder b = squareLevel();
  std::filesystem::create_directories(folder.path() / "inside");
  folder.write("secret.bin", b.buffer);
  std::filesystem::create_symlink(folder.path() / "secret.bin", folder.path() / "inside/link.bin");
  ASSERT_EQ(::mkfifo((folder.path() / "inside/fifo").c_str(), 0600), 0);
  for (const char* uri : {"../secret.bin", "%2e%2e/secret.bin", "a/../../secret.bin", "..\\secret.bin", "/etc/passwd", "file:///etc/passwd",
                          "http://localhost/a", "link.bin", "fifo", "."}) {
    b.json["buffers"] = {{{"byteLength", b.buffer.size()}, {"uri", uri}}};
    EXPECT_EQ(errorOf(folder.write("inside/level.gltf", b.json.dump())).kind, Exit::Broken) << uri;
  }
}

TEST(Level, SpacesAndSubFoldersInUrisAreFound) {
  Folder folder;
  Builder b = squareLevel();
  folder.write(
      "sub dir/b\xc3\xbc"
      "f.bin",
      b.buffer);
  b.json["buffers"] = {{{"byteLength", b.buffer.size()}, {"uri", "./sub%20dir/x/../b%C3%BCf.bin"}}};
  std::filesystem::create_directories(folder.path() / "sub dir/x");
  EXPECT_EQ(load(folder.write("level.gltf", b.json.dump())).triangles.size(), 2u);
}

TEST(Level, LimitsOnInputHold) {
  Folder folder;
  Builder b = squareLevel();
  const auto file = b.save(folder);
  EXPECT_EQ(errorOf(file, {.maxInputBytes = 100}).code, "LMC_INPUT_TOO_LARGE");
  EXPECT_EQ(errorOf(file, {.maxJsonDepth = 3}).code, "LMC_JSON");
  EXPECT_EQ(errorOf(file, {.maxNodes = 0}).code, "LMC_MEMORY_LIMIT");
  EXPECT_EQ(errorOf(file, {.maxTriangles = 1}).code, "LMC_MEMORY_LIMIT");
  EXPECT_EQ(errorOf(file, {.maxExtent_m = 0.5}).code, "LMC_EXTENT_TOO_LARGE");
}

TEST(Level, ValuesInBuffersAreJudgedToo) {
  Folder folder;
  const auto codeWith = [&](const char* attribute, const std::vector<float>& values, std::size_t components) {
    Builder b = squareLevel();
    b.json["meshes"][0]["primitives"][0]["attributes"][attribute] = b.add(values, components == 3 ? "VEC3" : "VEC2", components);
    return errorOf(b.save(folder)).code;
  };
  EXPECT_EQ(codeWith("POSITION", {0, 0, 0, 1, NAN, 0, 1, 1, 0, 0, 1, 0}, 3), "LMC_POSITION_NOT_FINITE");
  EXPECT_EQ(codeWith("TEXCOORD_1", {0, 0, 1, INFINITY, 1, 1, 0, 1}, 2), "LMC_LIGHTMAP_UV_NOT_FINITE");
  Builder b = squareLevel();
  b.json["meshes"][0]["primitives"][0]["indices"] = b.add<std::uint16_t>({0, 1, 4}, "SCALAR", 1);
  EXPECT_EQ(errorOf(b.save(folder)).code, "LMC_INDEX_OUT_OF_RANGE");
  b.json["meshes"][0]["primitives"][0]["indices"] = b.add<std::uint8_t>({0, 1, 255}, "SCALAR", 1);
  EXPECT_EQ(errorOf(b.save(folder)).code, "LMC_INDEX_RESTART");
}

TEST(Level, NoFileStaysOpenHoweverManyLevelsAreLoadedOrRefused) {
  const auto openFiles = [] {
    const std::filesystem::directory_iterator all("/proc/self/fd");
    return std::distance(begin(all), end(all));
  };
  Folder folder;
  Builder b = squareLevel();
  const auto good = b.save(folder);
  b.json["images"] = {{{"uri", "cut.png"}}};
  b.json["textures"] = {{{"source", 0}}};
  b.json["materials"] = {{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}, {"metallicFactor", 0}}}}};
  b.json["meshes"][0]["primitives"][0]["material"] = 0;
  folder.write("cut.png", "\x89PNG\r\n\x1a\n");
  const auto bad = folder.write("bad.gltf", b.json.dump());
  const auto before = openFiles();
  for (int k = 0; k < 100; ++k) {
    load(good);
    EXPECT_EQ(errorOf(bad).code, "LMC_TEXTURE_BAD") << k;
  }
  EXPECT_EQ(openFiles(), before);
}

}  // namespace
}  // namespace lmc::test
