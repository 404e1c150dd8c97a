#include "libscene/level_out.h"

#include <fmt/format.h>

#include "libscene/gltf_read.h"

namespace lmc {
namespace {

constexpr std::size_t kMaxGlbBytes = 0xffffffffu;  // the lengths in a GLB are 32 bit

void pad(std::vector<std::uint8_t>& bytes, std::size_t to, std::uint8_t with) {
  while (bytes.size() % to != 0) bytes.push_back(with);
}

/// All buffers one behind the other as the new buffer 0, and the views moved to where their bytes are now. Buffers without
/// bytes (their meaning is not glTF's business) stay what they are, behind it.
std::vector<std::uint8_t> mergeBuffers(GltfFile& file) {
  struct Moved {
    std::size_t buffer = 0;
    std::uint64_t start = 0;
  };
  std::vector<std::uint8_t> bin;
  std::vector<Moved> moved;
  Json buffers = Json::array({Json::object()});
  for (std::size_t b = 0; b < file.buffers.size(); ++b) {
    if (file.buffers[b].empty()) {
      moved.push_back({buffers.size(), 0});
      buffers.push_back(file.json["buffers"][b]);
      continue;
    }
    pad(bin, 4, 0);
    moved.push_back({0, bin.size()});
    bin.insert(bin.end(), file.buffers[b].begin(), file.buffers[b].end());
  }
  file.json["buffers"] = std::move(buffers);
  for (Json& view : file.json["bufferViews"]) {
    const Moved& to = moved[view["buffer"].get<std::size_t>()];
    view["byteOffset"] = to.start + view.value("byteOffset", std::uint64_t(0));
    view["buffer"] = to.buffer;
    // Their numbers of buffers would be wrong now, and the bytes are there without them.
    for (const char* compression : {"EXT_meshopt_compression", "KHR_meshopt_compression"})
      if (extension(view, compression)) view["extensions"].erase(compression);
    if (const Json* left = member(view, "extensions"); left && left->empty()) view.erase("extensions");
  }
  return bin;
}

std::string mimeTypeOf(std::span<const std::uint8_t> bytes) {
  const auto startsWith = [&](std::string_view magic, std::size_t at) {
    return bytes.size() >= at + magic.size() && std::equal(magic.begin(), magic.end(), bytes.begin() + std::ptrdiff_t(at),
                                                           [](char a, std::uint8_t b) { return std::uint8_t(a) == b; });
  };
  if (startsWith("\x89PNG", 0)) return "image/png";
  if (startsWith("\xff\xd8\xff", 0)) return "image/jpeg";
  if (startsWith("WEBP", 8)) return "image/webp";
  if (startsWith("\xabKTX 20", 0)) return "image/ktx2";
  return "";
}

/// Pictures that are files or data URIs become views, so that the level stands alone.
void embedImages(GltfFile& file, const LoadLimits& limits, std::vector<std::uint8_t>& bin) {
  if (!member(file.json, "images")) return;
  for (std::size_t i = 0; i < file.json["images"].size(); ++i) {
    if (!member(file.json["images"][i], "uri")) continue;
    std::vector<std::uint8_t> bytes;
    try {
      bytes = imageBytes(file, i, limits);
    } catch (const Error&) {
      continue;  // loadLevel() did not need it: what the level says of it stays as it was
    }
    pad(bin, 4, 0);
    Json view = {{"buffer", 0}, {"byteOffset", bin.size()}, {"byteLength", bytes.size()}};
    bin.insert(bin.end(), bytes.begin(), bytes.end());
    file.json["bufferViews"].push_back(std::move(view));
    Json& image = file.json["images"][i];
    image.erase("uri");
    image["bufferView"] = file.json["bufferViews"].size() - 1;
    if (const std::string type = mimeTypeOf(bytes); !type.empty()) image["mimeType"] = type;
  }
}

/// extras.lmc of a node, made where it is not there. Extras that are no object have no room for it and are kept under "value".
Json& lmcOf(Json& node) {
  Json& extras = node["extras"];
  if (!extras.is_object() && !extras.is_null()) extras = Json{{"value", extras}};
  return extras["lmc"];
}

void mark(Json& gltf, const std::vector<NodeMap>& maps, const std::vector<std::uint32_t>& bakedLightNodes) {
  for (const NodeMap& map : maps)
    lmcOf(gltf["nodes"].at(map.node))["lightmap"] = Json{{"uri", map.uri}, {"scale", map.scale}, {"texCoord", map.texCoord}};
  for (const std::uint32_t node : bakedLightNodes) lmcOf(gltf["nodes"].at(node))["baked"] = true;
}

std::vector<std::uint8_t> glb(const std::string& json, const std::vector<std::uint8_t>& bin, const std::filesystem::path& file) {
  const std::size_t jsonSize = (json.size() + 3) / 4 * 4, binSize = (bin.size() + 3) / 4 * 4;
  const std::size_t size = 12 + 8 + jsonSize + (bin.empty() ? 0 : 8 + binSize);
  if (size > kMaxGlbBytes)
    throw Error(Exit::Limit, file, "", fmt::format("the level would be {} bytes as a GLB, which holds at most 4 GiB", size), "LMC_GLB");
  std::vector<std::uint8_t> out;
  out.reserve(size);
  const auto word = [&](std::size_t value) {
    for (int byte = 0; byte < 4; ++byte) out.push_back(std::uint8_t(value >> (8 * byte)));
  };
  for (const std::size_t value : {std::size_t(0x46546c67), std::size_t(2), size, jsonSize, std::size_t(0x4e4f534a)}) word(value);
  out.insert(out.end(), json.begin(), json.end());
  pad(out, 4, ' ');
  if (bin.empty()) return out;
  word(binSize);
  word(0x004e4942);
  out.insert(out.end(), bin.begin(), bin.end());
  pad(out, 4, 0);
  return out;
}

}  // namespace

std::vector<std::uint8_t> levelWithMaps(const std::filesystem::path& level, const LoadLimits& limits, const std::vector<NodeMap>& maps,
                                        const std::vector<std::uint32_t>& bakedLightNodes) {
  return withJsonErrors(level, [&] {
    GltfFile file = readGltf(level, limits, Run{});  // what there is to say of it was said when it was loaded
    for (const char* array : {"buffers", "bufferViews"})
      if (!member(file.json, array)) file.json[array] = Json::array();
    std::vector<std::uint8_t> bin = mergeBuffers(file);
    embedImages(file, limits, bin);
    mark(file.json, maps, bakedLightNodes);
    if (!bin.empty()) file.json["buffers"][0]["byteLength"] = bin.size();
    // Without bytes nothing can point to buffer 0, and glTF has no empty arrays.
    else if (file.json["buffers"].size() == 1)
      file.json.erase("buffers");
    if (file.json["bufferViews"].empty()) file.json.erase("bufferViews");
    return glb(file.json.dump(), bin, level);
  });
}

}  // namespace lmc
