#include "libscene/level_out.h"

#include <gtest/gtest.h>

#include <fstream>
#include <set>

#include "libscene/gltf_edit.h"
#include "libscene/image_file.h"
#include "libscene/parallel.h"
#include "libscene/unwrap.h"
#include "tests/libscene/gltf_files.h"

namespace lmc::test {
namespace {

Json jsonOf(const std::vector<std::uint8_t>& glb) {
  std::uint32_t size = 0;
  std::memcpy(&size, glb.data() + 12, 4);
  return Json::parse(glb.begin() + 20, glb.begin() + 20 + size);
}

std::string text(const std::vector<std::uint8_t>& bytes) { return {bytes.begin(), bytes.end()}; }

std::vector<std::uint8_t> out(const std::filesystem::path& file, const LevelMarks& marks = {}) {
  return levelWithMaps(file, {}, load(file), marks);
}

/// The scene with map UVs of its own, and the level that has them.
struct Unwrapped {
  Scene scene;
  std::vector<std::uint8_t> glb;
  Json json;
};
Unwrapped unwrapped(const std::filesystem::path& file) {
  Unwrapped u{load(file), {}, {}};
  const lmc::Run run;
  LevelMarks marks;
  withThreads(run, [&] { marks.side = layOut(u.scene, {.mode = UvMode::New, .mapSize = 64}, run).side; });
  marks.newUvs = true;
  u.glb = levelWithMaps(file, {}, u.scene, marks);
  u.json = jsonOf(u.glb);
  return u;
}

/// A level with a picture in a file, a second buffer, and things that lmc does not know.
Builder richLevel(const Folder& folder) {
  Builder b = squareLevel();
  folder.write("red.png", text(encodePng(Image<glm::u8vec4>(2, 2, glm::u8vec4(255, 0, 0, 255)), false)));
  b.json["images"] = {{{"uri", "red.png"}, {"name", "red"}}};
  b.json["textures"] = {{{"source", 0}}};
  b.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", 0}};
  b.json["extensionsUsed"] = {"X_unknown"};
  b.json["nodes"][0]["extensions"]["X_unknown"] = {{"b", 1}, {"a", 2}};
  b.json["nodes"][0]["extras"] = {{"lmc", {{"cast", true}}}, {"mine", "kept"}};
  return b;
}

TEST(LevelOut, TheLevelComesBackWithItsMarks) {
  Folder folder;
  Builder b = richLevel(folder);
  const auto file = b.save(folder);
  const auto glb = out(file, {.maps = {{"lightmap.exr", 2.0}}, .bakedLightNodes = {0}});
  const Json json = jsonOf(glb);
  EXPECT_EQ(json["nodes"][0]["extras"].dump(),
            R"({"lmc":{"cast":true,"lightmap":{"uri":"lightmap.exr","scale":2.0,"texCoord":1},"baked":true},"mine":"kept"})");
  EXPECT_EQ(json["nodes"][0]["extensions"].dump(), R"({"X_unknown":{"b":1,"a":2}})");
  EXPECT_EQ(json["images"][0]["name"], "red");

  const Scene before = load(file), after = load(folder.write("out/level.glb", text(glb)));
  EXPECT_EQ(after.positions_m, before.positions_m);
  EXPECT_EQ(after.triangles, before.triangles);
  EXPECT_EQ(after.mapUv, before.mapUv);
  ASSERT_EQ(after.images.size(), 1u);
  EXPECT_EQ(after.images[0].pixels, before.images[0].pixels);
}

TEST(LevelOut, ALevelThatChangedSinceItWasLoadedIsRefused) {
  // One byte more of a buffer, and a blank behind the JSON, are a sound level: only that it is not the one that was loaded speaks against
  // it. No bytes = the file is gone.
  for (const auto& [name, more] :
       std::vector<std::pair<std::string, std::string>>{{"level.gltf", " "}, {"level.bin", "x"}, {"red.png", "x"}, {"red.png", ""}}) {
    Folder folder;
    const auto file = richLevel(folder).save(folder);
    const Scene scene = load(file);
    const auto changed = file.parent_path() / name;
    if (more.empty())
      std::filesystem::remove(changed);
    else
      std::ofstream(changed, std::ios::app) << more;
    try {
      levelWithMaps(file, {}, scene, {});
      ADD_FAILURE() << name << " changed, and nothing was said";
    } catch (const Error& e) {
      EXPECT_EQ(e.code, "LMC_FILE_CHANGED") << name << ": " << e.what();
    }
  }
}

TEST(LevelOut, AnAnimationThatNamesNoAccessorStaysWhatItIs) {
  Folder folder;
  Builder b = squareLevel();
  b.json["animations"] = {
      {{"channels", Json::array()}, {"samplers", {{{"input", 123456789}, {"output", -1}}, {{"input", "x"}, {"output", 0}}}}}};
  const Json json = jsonOf(out(b.save(folder), {.more = [](GltfEdit&) {}}));
  EXPECT_EQ(json["animations"][0]["samplers"].dump(), R"([{"input":123456789,"output":-1},{"input":"x","output":0}])");
}

TEST(LevelOut, StandsAlone) {
  Folder folder;
  const Json json = jsonOf(out(richLevel(folder).save(folder)));
  ASSERT_EQ(json["buffers"].size(), 1u);
  EXPECT_FALSE(json["buffers"][0].contains("uri"));
  EXPECT_FALSE(json["images"][0].contains("uri"));
  EXPECT_EQ(json["images"][0]["mimeType"], "image/png");
}

TEST(LevelOut, SeveralBuffersBecomeOne) {
  Folder folder;
  Builder b = squareLevel();
  b.save(folder);
  folder.write("more.bin", "xyz" + b.buffer);
  b.json["buffers"].push_back({{"byteLength", b.buffer.size() + 3}, {"uri", "more.bin"}});
  for (auto& view : b.json["bufferViews"]) view["buffer"] = 0;
  b.json["bufferViews"].push_back({{"buffer", 1}, {"byteOffset", 0}, {"byteLength", 3}});
  const auto glb = out(folder.write("two.gltf", b.json.dump()));
  const Json view = jsonOf(glb)["bufferViews"].back();
  EXPECT_EQ(view["buffer"], 0);
  const std::size_t bin = glb.size() - (jsonOf(glb)["buffers"][0]["byteLength"].get<std::size_t>() + 3) / 4 * 4;
  EXPECT_EQ(text(glb).substr(bin + view["byteOffset"].get<std::size_t>(), 3), "xyz");
}

TEST(LevelOut, TheSameLevelIsTheSameBytes) {
  Folder folder;
  const auto file = richLevel(folder).save(folder);
  EXPECT_EQ(out(file, {.maps = {{"a.exr", 1.0}}, .bakedLightNodes = {}}), out(file, {.maps = {{"a.exr", 1.0}}, .bakedLightNodes = {}}));
}

TEST(LevelOut, APictureThatIsNotThereStaysNamed) {
  Folder folder;
  Builder b = richLevel(folder);
  b.json["images"].push_back({{"uri", "gone.png"}});  // no diffuse light depends on it
  EXPECT_EQ(jsonOf(out(b.save(folder)))["images"][1]["uri"], "gone.png");
}

TEST(LevelOut, WithoutBuffersThereIsNoBinChunk) {
  Folder folder;
  const auto glb = out(folder.write("a.gltf", R"({"asset":{"version":"2.0"}})"));
  EXPECT_EQ(jsonOf(glb).dump(), R"({"asset":{"version":"2.0"}})");
  EXPECT_EQ(load(folder.write("out.glb", text(glb))).triangles.size(), 0u);
}

/// The square's corners with what the file says of them, by place.
TEST(LevelOut, NewUvsComeBackAsTheyWereMade) {
  Folder folder;
  Builder b = richLevel(folder);
  auto& primitive = b.json["meshes"][0]["primitives"][0];
  primitive["attributes"]["COLOR_0"] = b.add<std::uint8_t>({10, 20, 30, 255, 40, 50, 60, 255, 70, 80, 90, 255, 1, 2, 3, 255}, "VEC4", 4);
  b.json["accessors"].back()["normalized"] = true;
  primitive["attributes"]["_MINE"] = b.add<std::uint16_t>({7, 8, 9, 10}, "SCALAR", 1);
  const Unwrapped u = unwrapped(b.save(folder));
  const Scene after = load(folder.write("out/level.glb", text(u.glb)));
  ASSERT_EQ(after.triangles.size(), u.scene.triangles.size());
  for (std::size_t t = 0; t < after.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t v = after.triangles[t][k], w = u.scene.triangles[t][k];
      EXPECT_EQ(after.positions_m[v], u.scene.positions_m[w]);
      EXPECT_EQ(after.mapUv[v], u.scene.mapUv[w]);
      EXPECT_EQ(after.uv0[v], u.scene.uv0[w]);
      EXPECT_EQ(after.colors[v], u.scene.colors[w]);
    }
  EXPECT_EQ(after.mapResolution, 64);
  const Json& attributes = u.json["meshes"][0]["primitives"][0]["attributes"];
  EXPECT_EQ(u.json["accessors"][attributes["COLOR_0"].get<std::size_t>()]["componentType"], 5121);
  EXPECT_EQ(u.json["accessors"][attributes["_MINE"].get<std::size_t>()]["componentType"], 5123);
  EXPECT_EQ(u.json["nodes"][0]["extensions"].dump(), R"({"X_unknown":{"b":1,"a":2}})");
  EXPECT_EQ(u.json["nodes"][0]["extras"]["mine"], "kept");
}

TEST(LevelOut, ATextureKeepsItsSecondSet) {
  Folder folder;
  Builder b = richLevel(folder);
  b.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 1;
  const Unwrapped u = unwrapped(b.save(folder));
  EXPECT_EQ(u.json["nodes"][0]["extras"]["lmc"]["lightmap"]["texCoord"], 2);
  const Scene after = load(folder.write("out/level.glb", text(u.glb)));
  EXPECT_EQ(after.objects[0].texCoord, 2u);
  ASSERT_FALSE(after.uv1.empty());
  for (std::size_t t = 0; t < after.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(after.mapUv[after.triangles[t][k]], u.scene.mapUv[u.scene.triangles[t][k]]);
      EXPECT_EQ(after.uv1[after.triangles[t][k]], u.scene.uv1[u.scene.triangles[t][k]]);
    }
}

TEST(LevelOut, SetsBelowTheMapsAreThere) {
  Folder folder;
  Builder b = squareLevel();
  auto& attributes = b.json["meshes"][0]["primitives"][0]["attributes"];
  attributes.erase("TEXCOORD_0");
  attributes.erase("TEXCOORD_1");
  const Unwrapped u = unwrapped(b.save(folder));
  const Json& got = u.json["meshes"][0]["primitives"][0]["attributes"];
  EXPECT_TRUE(got.contains("TEXCOORD_0"));  // glTF: sets are numbered from 0 without a gap
  EXPECT_TRUE(got.contains("TEXCOORD_1"));
}

TEST(LevelOut, InstancesAndUsesBecomeNodesOfTheirOwn) {
  Folder folder;
  Builder b = squareLevel();
  const int at = b.add<float>({0, 0, 0, 3, 0, 0, 0, 5, 0}, "VEC3", 3);
  b.json["nodes"] = {{{"mesh", 0}, {"name", "many"}},
                     {{"mesh", 0}, {"name", "one"}, {"translation", {9, 0, 0}}},
                     {{"mesh", 0}, {"name", "two"}, {"scale", {-1, 1, 1}}, {"translation", {20, 0, 0}}}};
  b.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["TRANSLATION"] = at;
  b.json["scenes"][0]["nodes"] = {0, 1, 2};
  b.json["extensionsUsed"] = {"EXT_mesh_gpu_instancing"};
  const auto file = b.save(folder);
  const Unwrapped u = unwrapped(file);
  EXPECT_FALSE(u.json.contains("extensionsUsed"));
  EXPECT_EQ(u.json["nodes"][0]["children"].size(), 3u);
  EXPECT_EQ(u.json["meshes"].size(), 5u);
  const Scene before = load(file), after = load(folder.write("out/level.glb", text(u.glb)));
  ASSERT_EQ(after.objects.size(), 5u);
  // The nodes' order may differ; their places and map UVs do not.
  const auto corners = [](const Scene& s, bool uvs) {
    std::multiset<std::array<float, 5>> out;
    for (const glm::uvec3& t : s.triangles)
      for (int k = 0; k < 3; ++k) {
        const glm::vec3 p = s.positions_m[t[k]] + glm::vec3(s.centre_m);
        out.insert({p.x, p.y, p.z, uvs ? s.mapUv[t[k]].x : 0.0f, uvs ? s.mapUv[t[k]].y : 0.0f});
      }
    return out;
  };
  EXPECT_EQ(corners(after, false), corners(before, false));
  EXPECT_EQ(corners(after, true), corners(u.scene, true));
}

/// Vertices anew, twice: what was added can be read again.
TEST(GltfEdit, ReadsWhatItWrote) {
  Folder folder;
  GltfEdit edit(squareLevel().save(folder), {});
  const auto before = edit.attribute(0, 0, "POSITION", 3);
  for (int round = 0; round < 2; ++round) {
    NewVertices corners;
    for (const glm::uvec3& t : edit.triangles(0, 0)) {
      const auto n = std::uint32_t(corners.source.size());
      for (int k = 0; k < 3; ++k) corners.source.push_back(t[k]);
      corners.triangles.emplace_back(n, n + 1, n + 2);
    }
    const Json primitive = edit.json()["meshes"][0]["primitives"][0];
    edit.json()["meshes"][0]["primitives"][0] = edit.withVertices(primitive, corners);
  }
  const auto after = edit.attribute(0, 0, "POSITION", 3);
  ASSERT_EQ(after.size(), 18u);
  const std::vector<std::uint32_t> order{0, 1, 2, 0, 2, 3};
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(after[3 * i + k], before[3 * order[i] + k]);
}

}  // namespace
}  // namespace lmc::test
