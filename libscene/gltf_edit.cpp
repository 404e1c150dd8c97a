#include "libscene/gltf_edit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <set>

#include "libscene/gltf_accessor.h"
#include "libscene/gltf_read.h"
#include "libscene/level_mesh.h"
#include "libscene/rng.h"

namespace lmc {
namespace {

constexpr std::size_t kMaxGlbBytes = 0xffffffffu;  // the lengths in a GLB are 32 bit
constexpr int kArrayBuffer = 34962, kElementArrayBuffer = 34963;

void pad(std::vector<std::uint8_t>& bytes, std::size_t to, std::uint8_t with) {
  while (bytes.size() % to != 0) bytes.push_back(with);
}

/// All buffers one behind the other as the new buffer 0, and the views moved to where their bytes are now. Buffers without
/// bytes (their meaning is not glTF's business) stay what they are, behind it.
std::vector<std::uint8_t> mergeBuffers(Json& json, const std::vector<std::vector<std::uint8_t>>& from) {
  struct Moved {
    std::size_t buffer = 0;
    std::uint64_t start = 0;
  };
  std::vector<std::uint8_t> bin;
  std::vector<Moved> moved;
  Json buffers = Json::array({Json::object()});
  for (std::size_t b = 0; b < from.size(); ++b) {
    if (from[b].empty()) {
      moved.push_back({buffers.size(), 0});
      buffers.push_back(json["buffers"][b]);
      continue;
    }
    pad(bin, 4, 0);
    moved.push_back({0, bin.size()});
    bin.insert(bin.end(), from[b].begin(), from[b].end());
  }
  json["buffers"] = std::move(buffers);
  for (Json& view : json["bufferViews"]) {
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

std::vector<std::uint8_t> asGlb(const std::string& json, const std::vector<std::uint8_t>& bin, const std::filesystem::path& file) {
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

/// RFC 4648, padded.
std::string base64(std::span<const std::uint8_t> bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 3; ++k) word = word << 8 | (i + k < bytes.size() ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += i + k <= bytes.size() ? kDigits[word >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

/// Extensions whose places of accessors and views forUses() knows, or that have none.
bool pointsAreKnown(const Json& json) {
  static const std::set<std::string_view> kKnown{"EXT_mesh_gpu_instancing", "EXT_texture_webp",   "KHR_lights_punctual",
                                                 "KHR_mesh_quantization",   "KHR_texture_basisu", "KHR_texture_transform",
                                                 "KHR_animation_pointer",   "KHR_node_visibility"};
  const Json* used = member(json, "extensionsUsed");
  return !used || std::ranges::all_of(*used, [](const Json& name) {
    return name.is_string() &&
           (kKnown.contains(name.get_ref<const std::string&>()) || name.get_ref<const std::string&>().starts_with("KHR_materials_"));
  });
}

/// f(accessor index as JSON) for every accessor that something names.
template <class F>
void forAccessors(Json& json, F f) {
  const auto each = [&](Json& parent, const char* key, auto&& g) {
    if (parent.contains(key))
      for (Json& item : parent[key]) g(item);
  };
  each(json, "meshes", [&](Json& mesh) {
    each(mesh, "primitives", [&](Json& p) {
      if (p.contains("indices")) f(p["indices"]);
      each(p, "attributes", f);
      each(p, "targets", [&](Json& target) {
        for (Json& a : target) f(a);
      });
    });
  });
  each(json, "skins", [&](Json& skin) {
    if (skin.contains("inverseBindMatrices")) f(skin["inverseBindMatrices"]);
  });
  each(json, "animations", [&](Json& animation) {
    each(animation, "samplers", [&](Json& sampler) {
      for (const char* key : {"input", "output"})
        if (sampler.contains(key)) f(sampler[key]);
    });
  });
  each(json, "nodes", [&](Json& node) {
    if (const Json* instancing = extension(node, "EXT_mesh_gpu_instancing"); instancing && member(*instancing, "attributes"))
      for (Json& a : node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]) f(a);
  });
}

template <class F>
void forViews(Json& json, F f) {
  if (json.contains("accessors"))
    for (Json& a : json["accessors"]) {
      if (a.contains("bufferView")) f(a["bufferView"]);
      if (a.contains("sparse"))
        for (const char* part : {"indices", "values"}) f(a["sparse"][part]["bufferView"]);
    }
  if (json.contains("images"))
    for (Json& image : json["images"])
      if (image.contains("bufferView")) f(image["bufferView"]);
}

/// Members of json[array] that `forUses` does not name go, and the names of the rest follow. A name of none (nobody checks animations)
/// stays.
template <class ForUses>
void keepUsed(Json& json, const char* array, ForUses forUses) {
  if (!json.contains(array)) return;
  std::vector<bool> used(json[array].size(), false);
  const auto namesOne = [&](const Json& index) {
    return index.is_number() && index.get<double>() >= 0.0 && index.get<double>() < double(used.size());
  };
  forUses(json, [&](Json& index) {
    if (namesOne(index)) used[index.get<std::size_t>()] = true;
  });
  std::vector<std::size_t> now(used.size());
  Json kept = Json::array();
  for (std::size_t i = 0; i < used.size(); ++i) {
    now[i] = kept.size();
    if (used[i]) kept.push_back(std::move(json[array][i]));
  }
  json[array] = std::move(kept);
  forUses(json, [&](Json& index) {
    if (namesOne(index)) index = now[index.get<std::size_t>()];
  });
}

/// What the accessor readers want to know of a primitive.
tinygltf::Primitive typedPrimitive(const Json& json) {
  tinygltf::Primitive out;
  out.mode = json.value("mode", TINYGLTF_MODE_TRIANGLES);
  out.indices = json.value("indices", -1);
  for (const auto& [name, accessor] : json["attributes"].items()) out.attributes[name] = accessor.get<int>();
  return out;
}

std::size_t fingerprint(std::span<const std::uint32_t> values) {
  std::uint64_t h = values.size();
  for (const std::uint32_t v : values) h = combine(h, v);
  return std::size_t(h);
}

}  // namespace

struct GltfEdit::State {
  State(const std::filesystem::path& level, const LoadLimits& l)
      : limits(l),
        file(readGltf(level, l, Run{})),
        model(typedModel(file)),
        json(file.json) {  // what there is to say of it is said on loading
    checkIndexValues(file, model);
    for (const char* array : {"accessors", "buffers", "bufferViews"})
      if (!member(json, array)) json[array] = Json::array();
    own = file.buffers.size();
    file.buffers.push_back(mergeBuffers(json, file.buffers));
  }

  std::vector<std::uint8_t>& bin() { return file.buffers[own]; }

  std::size_t addView(std::span<const std::uint8_t> bytes, int target, std::size_t stride = 0) {
    pad(bin(), 4, 0);
    Json view = {{"buffer", 0}, {"byteOffset", bin().size()}, {"byteLength", bytes.size()}};
    // What is added can be read again as what was there.
    tinygltf::BufferView& typed = model.bufferViews.emplace_back();
    typed.buffer = int(own);
    typed.byteOffset = bin().size();
    typed.byteLength = bytes.size();
    typed.byteStride = stride;
    if (target != 0) view["target"] = target;
    if (stride != 0) view["byteStride"] = stride;
    bin().insert(bin().end(), bytes.begin(), bytes.end());
    json["bufferViews"].push_back(std::move(view));
    return json["bufferViews"].size() - 1;
  }

  std::uint32_t addAccessor(Json accessor, int type) {
    tinygltf::Accessor& typed = model.accessors.emplace_back();
    typed.bufferView = accessor["bufferView"].get<int>();
    typed.componentType = accessor["componentType"].get<int>();
    typed.normalized = accessor.value("normalized", false);
    typed.count = accessor["count"].get<std::size_t>();
    typed.type = type;
    json["accessors"].push_back(std::move(accessor));
    return std::uint32_t(json["accessors"].size() - 1);
  }

  /// Elements `source` of an accessor as a new one.
  std::uint32_t gathered(int accessor, std::span<const std::uint32_t> source);

  LoadLimits limits;
  GltfFile file;  ///< as it came in
  tinygltf::Model model;
  Json json;                                                         ///< as it goes out
  std::vector<std::pair<std::size_t, Error>> unread;                 ///< pictures that embedImages() could not read, and why
  std::size_t own = 0;                                               ///< into file.buffers: buffer 0 of what goes out
  std::map<std::pair<int, std::size_t>, std::uint32_t> known;        ///< accessor and fingerprint of its vertices -> the new accessor
  std::map<std::pair<int, std::size_t>, std::uint32_t> knownFloats;  ///< by components and fingerprint
  std::map<std::size_t, std::uint32_t> knownTriangles;               ///< by fingerprint
};

std::uint32_t GltfEdit::State::gathered(int accessor, std::span<const std::uint32_t> source) {
  const auto [it, fresh] = known.try_emplace({accessor, fingerprint(source)});
  if (!fresh) return it->second;
  const tinygltf::Accessor a = model.accessors[std::size_t(accessor)];  // a copy: the list grows
  const std::vector<std::uint8_t> from = readBytes(file, model, accessor);
  const std::size_t size = a.count > 0 ? from.size() / a.count : 0, stride = (size + 3) / 4 * 4;
  std::vector<std::uint8_t> to(source.size() * stride, 0);
  for (std::size_t i = 0; i < source.size(); ++i) std::memcpy(to.data() + i * stride, from.data() + source[i] * size, size);

  Json out = json["accessors"][std::size_t(accessor)];
  const bool bounded = out.contains("min");
  for (const char* key : {"sparse", "byteOffset", "min", "max"}) out.erase(key);
  out["bufferView"] = addView(to, kArrayBuffer, stride != size ? stride : 0);
  out["count"] = source.size();
  if (bounded && !source.empty()) {
    const auto n = std::size_t(componentCount(a));
    const std::vector<double> values = readNumbers(file, model, accessor);
    for (const bool most : {false, true}) {
      Json& bound = out[most ? "max" : "min"] = Json::array();
      for (std::size_t c = 0; c < n; ++c) {
        double v = values[source[0] * n + c];
        for (const std::uint32_t s : source) v = most ? std::max(v, values[s * n + c]) : std::min(v, values[s * n + c]);
        if (a.componentType == TINYGLTF_COMPONENT_TYPE_FLOAT)
          bound.push_back(v);
        else
          bound.push_back(std::int64_t(v));
      }
    }
  }
  return it->second = addAccessor(std::move(out), a.type);
}

GltfEdit::GltfEdit(const std::filesystem::path& level, const LoadLimits& limits)
    : state_(withJsonErrors(level, [&] { return std::make_unique<State>(level, limits); })) {}
GltfEdit::~GltfEdit() = default;

GltfEdit::Json& GltfEdit::json() { return state_->json; }

void GltfEdit::embedImages() {
  Json& json = state_->json;
  if (!member(json, "images")) return;
  for (std::size_t i = 0; i < json["images"].size(); ++i) {
    Json& image = json["images"][i];
    if (!member(image, "uri")) continue;
    std::vector<std::uint8_t> bytes;
    try {
      bytes = imageBytes(state_->file, i, state_->limits);
    } catch (const Error& e) {
      state_->unread.emplace_back(i, e);  // what the level says of it stays as it was
      continue;
    }
    const Json inside = imageOf(bytes);
    image.erase("uri");
    image.update(inside);
  }
}

void GltfEdit::refuseChanged(const Scene& scene) const {
  const GltfFile& file = state_->file;
  for (const auto& [image, error] : state_->unread) {
    std::filesystem::path path;
    try {
      path = pathOfUri(file.path, file.json["images"][image]["uri"].get_ref<const std::string&>(), "");
    } catch (const Error&) {
      continue;  // loadLevel() could not read it either
    }
    if (std::ranges::find(scene.inputs, path) != scene.inputs.end()) throw error;
  }
  if (contentOf(file, scene.inputs) != scene.content)
    throw Error(Exit::Broken, file.path, "", "this file, or one that it names, changed while lmc was at work", "LMC_FILE_CHANGED");
}

GltfEdit::Json GltfEdit::imageOf(std::span<const std::uint8_t> bytes) {
  Json out{{"bufferView", state_->addView(bytes, 0)}};
  if (const std::string type = mimeTypeOf(bytes); !type.empty()) out["mimeType"] = type;
  return out;
}

std::vector<glm::uvec3> GltfEdit::triangles(std::uint32_t mesh, std::uint32_t primitive) const {
  const tinygltf::Primitive from = typedPrimitive(state_->json["meshes"].at(mesh)["primitives"].at(primitive));
  return hasTriangles(from) ? readTriangles(state_->file, state_->model, from) : std::vector<glm::uvec3>();
}

std::vector<float> GltfEdit::attribute(std::uint32_t mesh, std::uint32_t primitive, const char* name, int components) const {
  const auto attributes = typedPrimitive(state_->json["meshes"].at(mesh)["primitives"].at(primitive)).attributes;
  const auto it = attributes.find(name);
  if (it == attributes.end() || componentCount(state_->model.accessors[std::size_t(it->second)]) != components) return {};
  return readFloats(state_->file, state_->model, it->second);
}

std::vector<GltfEdit::Json> GltfEdit::expandInstances(std::uint32_t node) {
  std::vector<Json> out;
  for (const Trs& t : readInstances(state_->file, state_->model, node)) {
    const glm::dquat r = glm::dot(t.rotation, t.rotation) > 0.0 ? glm::normalize(t.rotation) : glm::dquat(1.0, 0.0, 0.0, 0.0);
    out.push_back({{"translation", {t.translation.x, t.translation.y, t.translation.z}},
                   {"rotation", {r.x, r.y, r.z, r.w}},
                   {"scale", {t.scale.x, t.scale.y, t.scale.z}}});
  }
  constexpr const char* kName = "EXT_mesh_gpu_instancing";
  Json& json = state_->json;
  Json& from = json["nodes"].at(node);
  if (!extension(from, kName)) return out;
  from["extensions"].erase(kName);
  if (from["extensions"].empty()) from.erase("extensions");
  if (std::ranges::none_of(json["nodes"], [&](const Json& n) { return extension(n, kName) != nullptr; }))
    for (const char* list : {"extensionsUsed", "extensionsRequired"}) {
      if (!json.contains(list)) continue;
      Json left = Json::array();
      for (const Json& name : json[list])
        if (name != kName) left.push_back(name);
      json[list] = left;
      if (left.empty()) json.erase(list);
    }
  return out;
}

std::uint32_t GltfEdit::addFloats(std::span<const float> values, int components) {
  constexpr const char* kTypes[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
  const std::span bits(reinterpret_cast<const std::uint32_t*>(values.data()), values.size());
  const auto [it, fresh] = state_->knownFloats.try_emplace({components, fingerprint(bits)});
  if (!fresh) return it->second;
  const std::size_t view = state_->addView({reinterpret_cast<const std::uint8_t*>(values.data()), values.size_bytes()}, kArrayBuffer);
  return it->second = state_->addAccessor({{"bufferView", view},
                                           {"componentType", TINYGLTF_COMPONENT_TYPE_FLOAT},
                                           {"count", values.size() / std::size_t(components)},
                                           {"type", kTypes[components - 1]}},
                                          components == 1 ? TINYGLTF_TYPE_SCALAR : components);
}

std::uint32_t GltfEdit::addTriangles(std::span<const glm::uvec3> triangles) {
  std::uint32_t most = 0;
  for (const glm::uvec3& t : triangles) most = std::max({most, t.x, t.y, t.z});
  const bool small = most < 0xffff;
  const std::size_t size = small ? 2 : 4;
  std::vector<std::uint8_t> bytes(triangles.size() * 3 * size);
  for (std::size_t i = 0; i < triangles.size() * 3; ++i) {
    const std::uint32_t v = triangles[i / 3][int(i % 3)];
    std::memcpy(bytes.data() + i * size, &v, size);  // little-endian, as glTF and every machine that this runs on
  }
  const std::size_t view = state_->addView(bytes, kElementArrayBuffer);
  return state_->addAccessor({{"bufferView", view},
                              {"componentType", small ? TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT : TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT},
                              {"count", triangles.size() * 3},
                              {"type", "SCALAR"}},
                             TINYGLTF_TYPE_SCALAR);
}

GltfEdit::Json GltfEdit::withVertices(const Json& primitive, const NewVertices& vertices) {
  Json out = primitive;
  const auto follow = [&](Json& attributes) {
    for (Json& accessor : attributes) accessor = state_->gathered(accessor.get<int>(), vertices.source);
  };
  follow(out["attributes"]);
  if (out.contains("targets"))
    for (Json& target : out["targets"]) follow(target);
  std::size_t print = vertices.triangles.size();
  for (const glm::uvec3& t : vertices.triangles) print = std::size_t(combine(combine(print, t.x), combine(t.y, t.z)));
  const auto [it, fresh] = state_->knownTriangles.try_emplace(print);
  if (fresh) it->second = addTriangles(vertices.triangles);
  out["indices"] = it->second;
  out.erase("mode");  // triangles are the default
  return out;
}

void GltfEdit::dropUnused() {
  Json& json = state_->json;
  if (!pointsAreKnown(json)) return;
  keepUsed(json, "meshes", [](Json& j, auto&& f) {
    if (j.contains("nodes"))
      for (Json& node : j["nodes"])
        if (node.contains("mesh")) f(node["mesh"]);
  });
  keepUsed(json, "accessors", [](Json& j, auto&& f) { forAccessors(j, f); });
  keepUsed(json, "bufferViews", [](Json& j, auto&& f) { forViews(j, f); });
  std::vector<std::uint8_t> bin;
  for (Json& view : json["bufferViews"]) {
    if (view["buffer"] != 0) continue;
    pad(bin, 4, 0);
    const auto start = view["byteOffset"].get<std::size_t>(), length = view["byteLength"].get<std::size_t>();
    view["byteOffset"] = bin.size();
    bin.insert(bin.end(), state_->bin().begin() + std::ptrdiff_t(start), state_->bin().begin() + std::ptrdiff_t(start + length));
  }
  state_->bin() = std::move(bin);
}

/// The JSON as glTF wants it: the buffer's length, no empty arrays.
void GltfEdit::finish() {
  Json& json = state_->json;
  if (!state_->bin().empty()) json["buffers"][0]["byteLength"] = state_->bin().size();
  // Without bytes nothing can point to buffer 0.
  else if (json["buffers"].size() == 1)
    json["buffers"] = Json::array();
  for (const char* array : {"accessors", "buffers", "bufferViews", "meshes"})
    if (json.contains(array) && json[array].empty()) json.erase(array);
}

std::vector<std::uint8_t> GltfEdit::glb() {
  finish();
  return withJsonErrors(state_->file.path, [&] { return asGlb(state_->json.dump(), state_->bin(), state_->file.path); });
}

std::vector<std::uint8_t> GltfEdit::gltf() {
  finish();
  Json out = state_->json;
  if (!state_->bin().empty()) out["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64(state_->bin());
  return withJsonErrors(state_->file.path, [&] {
    const std::string text = out.dump(2) + "\n";
    return std::vector<std::uint8_t>(text.begin(), text.end());
  });
}

}  // namespace lmc
