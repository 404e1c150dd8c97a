#include "libscene/gltf_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <unordered_set>

#include <fmt/format.h>

#include "libscene/gltf_rules.h"

namespace lmc {
namespace {

constexpr std::uint64_t kMaxZeroElements = 1u << 24;  // of an accessor without a buffer view, which costs no byte in the file
constexpr double kAffineTolerance = 1e-6;             // of a matrix' last row, for exporters that multiply in single precision

/// A place in the JSON as a chain, so that no pointer text is made until it is needed.
struct Place {
  const Place* up = nullptr;
  std::string_view key = {};
  std::size_t index = 0;

  Place child(std::string_view name) const { return {this, name, 0}; }
  Place child(std::size_t i) const { return {this, {}, i}; }
  std::string text() const {
    if (!up) return "";
    if (key.empty()) return up->text() + fmt::format("/{}", index);
    std::string escaped;  // RFC 6901
    for (const char c : key) escaped += c == '~' ? "~0" : c == '/' ? "~1" : std::string(1, c);
    return up->text() + "/" + escaped;
  }
};

using namespace rules;

int componentBytes(std::int64_t type) {
  switch (type) {
    case 5120:
    case 5121:
      return 1;
    case 5122:
    case 5123:
      return 2;
    case 5125:
    case 5126:
      return 4;
    default:
      return 0;
  }
}

unsigned componentBit(std::int64_t type) {
  return type >= 5120 && type <= 5126 && type != 5124 ? 1u << (type - 5120 - (type > 5123 ? 1 : 0)) : 0;
}

class Checker {
 public:
  Checker(const Json& gltf, const std::filesystem::path& file, const LoadLimits& limits, const Run& run)
      : gltf_(gltf), file_(file), limits_(limits), run_(run) {}
  void all();

 private:
  Error broken(const Place& place, std::string_view what, std::string_view code) const {
    return Error(Exit::Broken, file_, place.text(), what, code);
  }
  void checkObject(const Json& object, const Place& place, std::span<const Rule> rules) const;
  void checkMember(const Json& value, const Place& place, const Rule& rule) const;
  void checkIndex(const Json& value, const Place& place, const Rule& rule) const;
  void checkInteger(const Json& value, const Place& place, const Rule& rule) const;
  void checkNumber(const Json& value, const Place& place, const Rule& rule) const;
  void checkExtras(const Json& object, const Place& place, std::span<const Rule> rules) const;
  void versions() const;
  void extensions() const;
  void views() const;
  void accessors() const;
  void sparse(const Json& accessor, const Place& place, std::uint64_t elementBytes) const;
  void meshes() const;
  void primitive(const Json& json, const Place& place) const;
  void attribute(const Json& attributes, const Place& place, const AttributeRule& rule, std::uint64_t count) const;
  void images() const;
  void nodes() const;
  void transform(const Json& node, const Place& place) const;
  void instancing(const Json& node, const Place& place) const;
  void tree() const;
  void lights() const;
  void allExtras() const;

  const Json& array(std::string_view name) const {
    static const Json kNone = Json::array();
    const Json* found = name.starts_with('/') ? lightsArray() : member(gltf_, name);
    return found ? *found : kNone;
  }
  const Json* lightsArray() const {
    const Json* root = extension(gltf_, "KHR_lights_punctual");
    return root ? member(*root, "lights") : nullptr;
  }
  static std::uint64_t integer(const Json& object, std::string_view key, std::uint64_t fallback) {
    const Json* value = member(object, key);
    return value ? value->get<std::uint64_t>() : fallback;
  }

  const Json& gltf_;
  const std::filesystem::path& file_;
  const LoadLimits& limits_;
  const Run& run_;
  const Place root_{};
};

// ---- the tables at work. The recursion follows the tables, which are a few levels deep, never the file.

void Checker::checkObject(const Json& object, const Place& place, std::span<const Rule> rules) const {
  for (const Rule& rule : rules) {
    const Json* value = member(object, rule.key);
    if (value)
      checkMember(*value, place.child(rule.key), rule);
    else if (rule.required)
      throw broken(place, fmt::format("has no \"{}\"", rule.key), rule.code);
  }
}

void Checker::checkIndex(const Json& value, const Place& place, const Rule& rule) const {
  if (!value.is_number_integer()) throw broken(place, "is not an index", "LMC_REFERENCE");
  const std::size_t count = array(rule.of).size();
  if (!value.is_number_unsigned() || value.get<std::uint64_t>() >= count)
    throw broken(place, fmt::format("points to {} {}, there are {}", rule.of.substr(rule.of.rfind('/') + 1), value.dump(), count),
                 "LMC_REFERENCE");
}

void Checker::checkInteger(const Json& value, const Place& place, const Rule& rule) const {
  if (!value.is_number_integer()) throw broken(place, "is not a whole number", rule.code);
  checkNumber(value, place, rule);
}

void Checker::checkNumber(const Json& value, const Place& place, const Rule& rule) const {
  if (!value.is_number()) throw broken(place, "is not a number", rule.code);
  const double number = value.get<double>();
  if (!(number >= rule.low && number <= rule.high) || !std::isfinite(number))
    throw broken(place,
                 number < rule.low ? fmt::format("is {}, the least is {:g}", value.dump(), rule.low)
                                   : fmt::format("is {}, the most is {:g}", value.dump(), rule.high),
                 rule.code);
}

void Checker::checkMember(const Json& value, const Place& place, const Rule& rule) const {
  switch (rule.is) {
    case Is::Index:
      return checkIndex(value, place, rule);
    case Is::Integer:
      return checkInteger(value, place, rule);
    case Is::Number:
      return checkNumber(value, place, rule);
    case Is::Text:
      if (!value.is_string()) throw broken(place, "is not a string", rule.code);
      return;
    case Is::Flag:
      if (!value.is_boolean()) throw broken(place, "is neither true nor false", rule.code);
      return;
    case Is::Object:
      if (!value.is_object()) throw broken(place, "is not an object", rule.code);
      return checkObject(value, place, rule.rules);
    default:
      break;
  }
  if (!value.is_array()) throw broken(place, "is not an array", rule.code);
  if (rule.length != 0 && value.size() != rule.length)
    throw broken(place, fmt::format("has {} values instead of {}", value.size(), rule.length), rule.code);
  for (std::size_t i = 0; i < value.size(); ++i) {
    const Place at = place.child(i);
    if (rule.is == Is::Numbers) checkNumber(value[i], at, rule);
    if (rule.is == Is::Indices) checkIndex(value[i], at, rule);
    if (rule.is == Is::Texts && !value[i].is_string()) throw broken(at, "is not a string", rule.code);
    if (rule.is == Is::Array && !value[i].is_object()) throw broken(at, "is not an object", rule.code);
    if (rule.is == Is::Array) checkObject(value[i], at, rule.rules);
  }
}

void Checker::checkExtras(const Json& object, const Place& place, std::span<const Rule> rules) const {
  const Json* extras = member(object, "extras");
  const Json* lmc = extras ? member(*extras, "lmc") : nullptr;
  if (!lmc) return;
  const Place extrasPlace = place.child("extras"), lmcPlace = extrasPlace.child("lmc");
  if (!lmc->is_object()) throw broken(lmcPlace, "is not an object", "LMC_EXTRAS");
  checkObject(*lmc, lmcPlace, rules);
}

// ---- what needs two members at once

void Checker::versions() const {
  const Place asset = root_.child("asset");
  const auto numbers = [&](const char* key) -> std::pair<int, int> {
    const auto& text = gltf_["asset"][key].get_ref<const std::string&>();
    int major = 0, minor = 0, used = 0;
    if (std::sscanf(text.c_str(), "%3d.%3d%n", &major, &minor, &used) != 2 || std::size_t(used) != text.size() || major < 0 || minor < 0)
      throw broken(asset.child(key), fmt::format("\"{}\" is not a version", text), "LMC_VERSION");
    return {major, minor};
  };
  const auto unsupported = [&](const char* key) {
    return Error(Exit::Unsupported, file_, asset.child(key).text(),
                 fmt::format("glTF {} is not supported, only 2.0", gltf_["asset"][key].get<std::string>()), "LMC_VERSION");
  };
  if (member(gltf_["asset"], "minVersion"))
    if (numbers("minVersion") > std::pair(2, 0)) throw unsupported("minVersion");
  if (numbers("version").first != 2) throw unsupported("version");
}

void Checker::extensions() const {
  const auto find = [](std::string_view name) { return std::ranges::find(kExtensions, name, &KnownExtension::name); };
  std::unordered_set<std::string> used, required;
  for (const Json& name : array("extensionsUsed")) used.insert(name.get<std::string>());
  const Place requiredPlace = root_.child("extensionsRequired");
  for (std::size_t i = 0; i < array("extensionsRequired").size(); ++i) {
    const auto& name = array("extensionsRequired")[i].get_ref<const std::string&>();
    const auto known = find(name);
    required.insert(name);
    if (known == std::end(kExtensions))
      throw Error(Exit::Unsupported, file_, requiredPlace.child(i).text(),
                  fmt::format("the level requires {}, which lmc does not know", name), "LMC_EXTENSION");
    if (known->use == Use::Refused)
      throw Error(Exit::Unsupported, file_, requiredPlace.child(i).text(), fmt::format("the level requires {}: {}", name, known->words),
                  "LMC_EXTENSION");
    if (!used.contains(name))
      throw broken(requiredPlace.child(i), fmt::format("{} is required, but not listed in extensionsUsed", name), "LMC_EXTENSION");
  }
  for (const Json& json : array("extensionsUsed")) {
    const auto& name = json.get_ref<const std::string&>();
    if (used.erase(name) == 0) continue;  // listed twice
    const auto known = find(name);
    const bool read = known != std::end(kExtensions) && known->use == Use::Read;
    const bool notDiffuse = known != std::end(kExtensions) && known->use == Use::NotDiffuse;
    if (read || (notDiffuse && !required.contains(name))) continue;
    run_.note({.file = file_.string(),
               .where = "/extensionsUsed",
               .text = notDiffuse ? fmt::format("{} does not change diffuse light and is not read", name)
                                  : fmt::format("{} is not known and not required: it is not read", name),
               .code = "LMC_EXTENSION"});
  }
}

void Checker::views() const {
  const Place list = root_.child("bufferViews");
  for (std::size_t i = 0; i < array("bufferViews").size(); ++i) {
    const Json& view = array("bufferViews")[i];
    const Place place = list.child(i);
    const std::uint64_t buffer = array("buffers")[view["buffer"].get<std::size_t>()]["byteLength"].get<std::uint64_t>();
    const std::uint64_t offset = integer(view, "byteOffset", 0), length = integer(view, "byteLength", 0);
    if (offset > buffer || length > buffer - offset)
      throw broken(place, fmt::format("{} bytes from byte {} pass the end of its buffer of {} bytes", length, offset, buffer),
                   "LMC_BUFFER_VIEW");
    if (integer(view, "byteStride", 4) % 4 != 0)
      throw broken(place.child("byteStride"), fmt::format("is {}, not a multiple of 4", view["byteStride"].dump()), "LMC_STRIDE");
  }
}

/// Bytes of one element; columns of matrices start at multiples of 4.
std::uint64_t elementBytes(const ElementType& type, int component) {
  const int column = type.rows * component;
  return std::uint64_t(type.columns > 1 ? type.columns * ((column + 3) / 4 * 4) : column);
}

void Checker::accessors() const {
  const Place list = root_.child("accessors");
  for (std::size_t i = 0; i < array("accessors").size(); ++i) {
    const Json& accessor = array("accessors")[i];
    const Place place = list.child(i);
    const int component = componentBytes(accessor["componentType"].get<std::int64_t>());
    if (component == 0)
      throw broken(place.child("componentType"), fmt::format("{} is none", accessor["componentType"].dump()), "LMC_ACCESSOR_TYPE");
    const auto type = std::ranges::find(kTypes, std::string_view(accessor["type"].get_ref<const std::string&>()), &ElementType::name);
    if (type == std::end(kTypes))
      throw broken(place.child("type"), fmt::format("{} is none", accessor["type"].dump()), "LMC_ACCESSOR_TYPE");
    const std::uint64_t size = elementBytes(*type, component), count = accessor["count"].get<std::uint64_t>();
    const std::uint64_t offset = integer(accessor, "byteOffset", 0);
    if (const Json* viewIndex = member(accessor, "bufferView")) {
      const Json& view = array("bufferViews")[viewIndex->get<std::size_t>()];
      const std::uint64_t length = integer(view, "byteLength", 0), stride = integer(view, "byteStride", size);
      if (stride < size)
        throw broken(place, fmt::format("its view's stride of {} is less than an element of {} bytes", stride, size), "LMC_STRIDE");
      // offset + stride (count - 1) + size <= length, with nothing that can overflow
      if (offset > length || size > length - offset || count - 1 > (length - offset - size) / stride)
        throw broken(place, fmt::format("{} elements from byte {} pass the end of its view of {} bytes", count, offset, length),
                     "LMC_ACCESSOR_RANGE");
      if ((offset + integer(view, "byteOffset", 0)) % std::uint64_t(component) != 0 || offset % std::uint64_t(component) != 0)
        throw broken(place, fmt::format("starts at no multiple of its {}-byte components", component), "LMC_ALIGNMENT");
    } else if (count > kMaxZeroElements) {
      throw broken(place, fmt::format("has no view, which means {} zeros; the most is {}", count, kMaxZeroElements), "LMC_MEMORY_LIMIT");
    }
    if (member(accessor, "sparse")) sparse(accessor, place, size);
  }
}

void Checker::sparse(const Json& accessor, const Place& place, std::uint64_t elementSize) const {
  const Place at = place.child("sparse");
  const Json& json = accessor["sparse"];
  const std::uint64_t count = json["count"].get<std::uint64_t>();
  if (count > accessor["count"].get<std::uint64_t>()) throw broken(at, "replaces more elements than there are", "LMC_ACCESSOR_RANGE");
  const auto type = json["indices"]["componentType"].get<std::int64_t>();
  if (type != 5121 && type != 5123 && type != 5125)
    throw broken(at.child("indices"), fmt::format("componentType {} is no unsigned integer", type), "LMC_ACCESSOR_TYPE");
  const auto fits = [&](const char* part, std::uint64_t size, std::uint64_t alignment) {
    const Json& list = json[part];
    const Json& view = array("bufferViews")[list["bufferView"].get<std::size_t>()];
    const std::uint64_t offset = integer(list, "byteOffset", 0), length = integer(view, "byteLength", 0);
    if (offset > length || count > (length - offset) / size)
      throw broken(at.child(part), fmt::format("{} elements pass the end of its view", count), "LMC_ACCESSOR_RANGE");
    if ((offset + integer(view, "byteOffset", 0)) % alignment != 0)
      throw broken(at.child(part), fmt::format("starts at no multiple of its {}-byte components", alignment), "LMC_ALIGNMENT");
  };
  const auto indexSize = std::uint64_t(componentBytes(type));
  fits("indices", indexSize, indexSize);
  fits("values", elementSize, std::uint64_t(componentBytes(accessor["componentType"].get<std::int64_t>())));
}

void Checker::attribute(const Json& attributes, const Place& place, const AttributeRule& rule, std::uint64_t count) const {
  const Json* index = member(attributes, rule.name);
  if (!index) return;
  const Place at = place.child(rule.name);
  const Json& accessor = array("accessors")[index->get<std::size_t>()];
  const auto& type = accessor["type"].get_ref<const std::string&>();
  if (rule.types.find(type) == std::string_view::npos)
    throw broken(at, fmt::format("its accessor is {}, not {}", type, rule.types), "LMC_ACCESSOR_TYPE");
  const auto& used = array("extensionsUsed");
  const bool quantized = std::any_of(used.begin(), used.end(), [](const Json& name) { return name == "KHR_mesh_quantization"; });
  if ((componentBit(accessor["componentType"].get<std::int64_t>()) & (quantized ? rule.quantized : rule.components)) == 0)
    throw broken(at, fmt::format("component type {} is not allowed here", accessor["componentType"].dump()), "LMC_ACCESSOR_TYPE");
  if (accessor["count"].get<std::uint64_t>() != count)
    throw broken(at, fmt::format("has {} elements, POSITION has {}", accessor["count"].dump(), count), "LMC_ATTRIBUTE_COUNT");
}

void Checker::primitive(const Json& json, const Place& place) const {
  const Place at = place.child("attributes");
  const Json& attributes = json["attributes"];
  const Rule reference{.key = {}, .is = Is::Index, .of = "accessors"};
  for (const auto& [name, index] : attributes.items()) checkIndex(index, at.child(name), reference);
  if (const Json* targets = member(json, "targets"))
    for (std::size_t t = 0; t < targets->size(); ++t) {
      const Place targetsPlace = place.child("targets"), target = targetsPlace.child(t);
      if (!(*targets)[t].is_object()) throw broken(target, "is not an object", "LMC_JSON_SCHEMA");
      for (const auto& [name, index] : (*targets)[t].items()) checkIndex(index, target.child(name), reference);
    }
  const Json* position = member(attributes, "POSITION");
  std::uint64_t corners = position ? array("accessors")[position->get<std::size_t>()]["count"].get<std::uint64_t>() : 0;
  if (position)
    for (const AttributeRule& rule : kAttributes) attribute(attributes, at, rule, corners);
  if (const Json* indices = member(json, "indices")) {
    const Json& accessor = array("accessors")[indices->get<std::size_t>()];
    const auto type = accessor["componentType"].get<std::int64_t>();
    if (accessor["type"] != "SCALAR" || (type != 5121 && type != 5123 && type != 5125))
      throw broken(place.child("indices"), "its accessor is no SCALAR of unsigned integers", "LMC_ACCESSOR_TYPE");
    corners = accessor["count"].get<std::uint64_t>();
  }
  const std::uint64_t mode = integer(json, "mode", 4);
  if (position && mode >= 4 && (corners < 3 || (mode == 4 && corners % 3 != 0)))
    run_.warn({.file = file_.string(),
               .where = place.text(),
               .text = fmt::format("{} corners make no whole triangles; the rest is left out", corners),
               .code = "LMC_INDEX_COUNT"});
}

void Checker::meshes() const {
  const Place list = root_.child("meshes");
  for (std::size_t m = 0; m < array("meshes").size(); ++m) {
    const Place mesh = list.child(m), primitives = mesh.child("primitives");
    const Json& all = array("meshes")[m]["primitives"];
    if (all.empty()) throw broken(primitives, "is empty", "LMC_JSON_SCHEMA");
    for (std::size_t p = 0; p < all.size(); ++p) primitive(all[p], primitives.child(p));
  }
}

void Checker::images() const {
  const Place list = root_.child("images");
  for (std::size_t i = 0; i < array("images").size(); ++i) {
    const Json& image = array("images")[i];
    const Place place = list.child(i);
    if (member(image, "uri") && member(image, "bufferView")) throw broken(place, "has both uri and bufferView", "LMC_JSON_SCHEMA");
    // Pictures that no diffuse light depends on are never opened; where they lie is judged all the same.
    if (const Json* uri = member(image, "uri"))
      checkUri(file_, uri->get_ref<const std::string&>(), place.child("uri").text());
    else if (!member(image, "bufferView"))
      throw broken(place, "has neither uri nor bufferView", "LMC_JSON_SCHEMA");
  }
}

void Checker::transform(const Json& node, const Place& place) const {
  const Json* matrix = member(node, "matrix");
  if (const Json* rotation = member(node, "rotation")) {
    double square = 0.0;
    for (const Json& v : *rotation) square += v.get<double>() * v.get<double>();
    if (!(square > 1e-12) || !std::isfinite(square))
      throw broken(place.child("rotation"), "is no rotation: its length is 0", "LMC_ROTATION");
  }
  if (!matrix) return;
  for (const char* other : {"translation", "rotation", "scale"})
    if (member(node, other)) throw broken(place, fmt::format("has both matrix and {}", other), "LMC_JSON_SCHEMA");
  static constexpr double kLastRow[4] = {0, 0, 0, 1};
  for (std::size_t column = 0; column < 4; ++column)
    if (std::abs((*matrix)[4 * column + 3].get<double>() - kLastRow[column]) > kAffineTolerance)
      throw broken(place.child("matrix"), "its last row is not 0 0 0 1", "LMC_MATRIX_BAD");
}

void Checker::instancing(const Json& node, const Place& place) const {
  const Json* json = extension(node, "EXT_mesh_gpu_instancing");
  if (!json) return;
  const Place extensionsPlace = place.child("extensions"), own = extensionsPlace.child("EXT_mesh_gpu_instancing"),
              at = own.child("attributes");
  const Json& attributes = (*json)["attributes"];
  std::uint64_t count = 0;
  for (const auto& [key, type, components] : {std::tuple("TRANSLATION", "VEC3", 32u), {"ROTATION", "VEC4", 37u}, {"SCALE", "VEC3", 32u}}) {
    const Json* index = member(attributes, key);
    if (!index) continue;
    const Json& accessor = array("accessors")[index->get<std::size_t>()];
    if (accessor["type"] != type || (componentBit(accessor["componentType"].get<std::int64_t>()) & components) == 0)
      throw broken(at.child(key), fmt::format("its accessor is not of the right kind ({})", type), "LMC_ACCESSOR_TYPE");
    const auto own_count = accessor["count"].get<std::uint64_t>();
    if (count != 0 && own_count != count) throw broken(at.child(key), "the attributes have different counts", "LMC_ATTRIBUTE_COUNT");
    count = own_count;
  }
}

void Checker::nodes() const {
  const Place list = root_.child("nodes");
  if (array("nodes").size() > limits_.maxNodes)
    throw broken(list, fmt::format("{} nodes; the most is {}", array("nodes").size(), limits_.maxNodes), "LMC_MEMORY_LIMIT");
  for (std::size_t i = 0; i < array("nodes").size(); ++i) {
    transform(array("nodes")[i], list.child(i));
    instancing(array("nodes")[i], list.child(i));
  }
}

/// Each node has one parent at most, and no node is below itself.
void Checker::tree() const {
  const Json& all = array("nodes");
  const Place list = root_.child("nodes");
  constexpr std::size_t kRoot = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> parent(all.size(), kRoot);
  for (std::size_t i = 0; i < all.size(); ++i)
    if (const Json* children = member(all[i], "children"))
      for (const Json& child : *children) {
        const auto c = child.get<std::size_t>();
        if (c == i) throw broken(list.child(i), "is its own child", "LMC_NODE_CYCLE");
        if (parent[c] != kRoot)
          throw broken(list.child(c), fmt::format("is a child of node {} and of node {}", parent[c], i), "LMC_NODE_PARENTS");
        parent[c] = i;
      }
  // With one parent each, what does not hang on a root hangs on a cycle. A node is counted when its parents are seen to end.
  std::vector<std::uint8_t> ends(all.size(), 0);
  std::vector<std::size_t> chain;
  for (std::size_t i = 0; i < all.size(); ++i) {
    chain.clear();
    std::size_t n = i;
    for (; n != kRoot && ends[n] == 0; n = parent[n]) {
      ends[n] = 1;
      chain.push_back(n);
    }
    if (n != kRoot && ends[n] == 1) throw broken(list.child(n), "is a child of itself by way of others", "LMC_NODE_CYCLE");
    for (const std::size_t c : chain) ends[c] = 2;
  }
  const Place scenes = root_.child("scenes");
  for (std::size_t s = 0; s < array("scenes").size(); ++s) {
    const Place scene = scenes.child(s), roots = scene.child("nodes");
    const Json* nodesOfScene = member(array("scenes")[s], "nodes");
    std::unordered_set<std::size_t> seen;
    for (std::size_t i = 0; nodesOfScene && i < nodesOfScene->size(); ++i) {
      const auto n = (*nodesOfScene)[i].get<std::size_t>();
      if (parent[n] != kRoot)
        throw broken(roots.child(i), fmt::format("node {} is no root, it is a child of node {}", n, parent[n]), "LMC_NODE_PARENTS");
      if (!seen.insert(n).second) throw broken(roots.child(i), fmt::format("node {} stands twice in the scene", n), "LMC_NODE_PARENTS");
    }
  }
}

void Checker::lights() const {
  const Json* all = lightsArray();
  if (!all) return;
  const Place extensionsPlace = root_.child("extensions"), own = extensionsPlace.child("KHR_lights_punctual"), list = own.child("lights");
  for (std::size_t i = 0; i < all->size(); ++i) {
    const Json& light = (*all)[i];
    const Place place = list.child(i);
    const auto& type = light["type"].get_ref<const std::string&>();
    if (type != "point" && type != "spot" && type != "directional")
      throw broken(place.child("type"), fmt::format("{} is no kind of light", light["type"].dump()), "LMC_LIGHT_TYPE");
    if (const Json* range = member(light, "range"); range && range->get<double>() == 0.0)
      throw broken(place.child("range"), "is 0", "LMC_LIGHT_RANGE");
    const Json* spot = member(light, "spot");
    if (type == "spot" && !spot) throw broken(place, "a spot light without \"spot\"", "LMC_SPOT_ANGLES");
    if (spot && type == "spot") {
      const double inner_rad = spot->value("innerConeAngle", 0.0), outer_rad = spot->value("outerConeAngle", std::numbers::pi / 4);
      if (inner_rad > outer_rad) throw broken(place.child("spot"), "the inner cone is wider than the outer", "LMC_SPOT_ANGLES");
    }
    checkExtras(light, place, kLightLmcRules);
  }
}

void Checker::allExtras() const {
  for (const auto& [name, rules] : {std::pair<std::string_view, std::span<const Rule>>("scenes", kSceneLmcRules),
                                    {"nodes", kNodeLmcRules},
                                    {"materials", kMaterialLmcRules}}) {
    const Place list = root_.child(name);
    for (std::size_t i = 0; i < array(name).size(); ++i) checkExtras(array(name)[i], list.child(i), rules);
  }
}

void Checker::all() {
  // References count the entries of arrays, so these must be arrays before anything else is looked at.
  for (const Rule& rule : kRootRules)
    if (const Json* value = rule.is == Is::Array ? member(gltf_, rule.key) : nullptr; value && !value->is_array())
      throw broken(root_.child(rule.key), "is not an array", rule.code);
  if (!member(gltf_, "asset")) throw broken(root_, "has no \"asset\"", "LMC_VERSION");
  checkObject(gltf_, root_, std::span(kRootRules).first(3));
  versions();
  extensions();
  checkObject(gltf_, root_, kRootRules);
  views();
  accessors();
  meshes();
  images();
  nodes();
  tree();
  lights();
  allExtras();
}

}  // namespace

void checkGltf(const Json& gltf, const std::filesystem::path& file, const LoadLimits& limits, const Run& run) {
  Checker(gltf, file, limits, run).all();
}

std::uint64_t instanceCount(const Json& node, const Json& gltf) {
  const Json* instancing = extension(node, "EXT_mesh_gpu_instancing");
  if (!instancing) return 1;
  for (const char* key : {"TRANSLATION", "ROTATION", "SCALE"})
    if (const Json* accessor = member((*instancing)["attributes"], key))
      return gltf["accessors"][accessor->get<std::size_t>()]["count"].get<std::uint64_t>();
  return 0;
}

}  // namespace lmc
