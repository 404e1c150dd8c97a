#include "libscene/level_out.h"

#include <gtest/gtest.h>

#include "libscene/image_file.h"
#include "tests/libscene/gltf_files.h"

namespace lmc::test {
namespace {

Json jsonOf(const std::vector<std::uint8_t>& glb) {
  std::uint32_t size = 0;
  std::memcpy(&size, glb.data() + 12, 4);
  return Json::parse(glb.begin() + 20, glb.begin() + 20 + size);
}

std::string text(const std::vector<std::uint8_t>& bytes) { return {bytes.begin(), bytes.end()}; }

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
  const auto glb = levelWithMaps(file, {}, {{.node = 0, .uri = "lightmap.exr", .scale = 2.0}}, {0});
  const Json out = jsonOf(glb);
  EXPECT_EQ(out["nodes"][0]["extras"].dump(),
            R"({"lmc":{"cast":true,"lightmap":{"uri":"lightmap.exr","scale":2.0,"texCoord":1},"baked":true},"mine":"kept"})");
  EXPECT_EQ(out["nodes"][0]["extensions"].dump(), R"({"X_unknown":{"b":1,"a":2}})");
  EXPECT_EQ(out["images"][0]["name"], "red");

  const Scene before = load(file), after = load(folder.write("out/level.glb", text(glb)));
  EXPECT_EQ(after.positions_m, before.positions_m);
  EXPECT_EQ(after.triangles, before.triangles);
  EXPECT_EQ(after.mapUv, before.mapUv);
  ASSERT_EQ(after.images.size(), 1u);
  EXPECT_EQ(after.images[0].pixels, before.images[0].pixels);
}

TEST(LevelOut, StandsAlone) {
  Folder folder;
  const Json out = jsonOf(levelWithMaps(richLevel(folder).save(folder), {}, {}, {}));
  ASSERT_EQ(out["buffers"].size(), 1u);
  EXPECT_FALSE(out["buffers"][0].contains("uri"));
  EXPECT_FALSE(out["images"][0].contains("uri"));
  EXPECT_EQ(out["images"][0]["mimeType"], "image/png");
}

TEST(LevelOut, SeveralBuffersBecomeOne) {
  Folder folder;
  Builder b = squareLevel();
  b.save(folder);
  folder.write("more.bin", "xyz" + b.buffer);
  b.json["buffers"].push_back({{"byteLength", b.buffer.size() + 3}, {"uri", "more.bin"}});
  for (auto& view : b.json["bufferViews"]) view["buffer"] = 0;
  b.json["bufferViews"].push_back({{"buffer", 1}, {"byteOffset", 0}, {"byteLength", 3}});
  const auto glb = levelWithMaps(folder.write("two.gltf", b.json.dump()), {}, {}, {});
  const Json view = jsonOf(glb)["bufferViews"].back();
  EXPECT_EQ(view["buffer"], 0);
  const std::size_t bin = glb.size() - (jsonOf(glb)["buffers"][0]["byteLength"].get<std::size_t>() + 3) / 4 * 4;
  EXPECT_EQ(text(glb).substr(bin + view["byteOffset"].get<std::size_t>(), 3), "xyz");
}

TEST(LevelOut, TheSameLevelIsTheSameBytes) {
  Folder folder;
  const auto file = richLevel(folder).save(folder);
  EXPECT_EQ(levelWithMaps(file, {}, {{.node = 0, .uri = "a.exr"}}, {}), levelWithMaps(file, {}, {{.node = 0, .uri = "a.exr"}}, {}));
}

TEST(LevelOut, APictureThatIsNotThereStaysNamed) {
  Folder folder;
  Builder b = richLevel(folder);
  b.json["images"].push_back({{"uri", "gone.png"}});  // no diffuse light depends on it
  EXPECT_EQ(jsonOf(levelWithMaps(b.save(folder), {}, {}, {}))["images"][1]["uri"], "gone.png");
}

TEST(LevelOut, WithoutBuffersThereIsNoBinChunk) {
  Folder folder;
  const auto glb = levelWithMaps(folder.write("a.gltf", R"({"asset":{"version":"2.0"}})"), {}, {}, {});
  EXPECT_EQ(jsonOf(glb).dump(), R"({"asset":{"version":"2.0"}})");
  EXPECT_EQ(load(folder.write("out.glb", text(glb))).triangles.size(), 0u);
}

}  // namespace
}  // namespace lmc::test
