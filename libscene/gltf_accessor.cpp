#include "libscene/gltf_accessor.h"

#include <algorithm>
#include <cassert>
#include <cstring>
#include <limits>
#include <type_traits>

#include <fmt/format.h>

namespace lmc {
namespace {

/// One component as it is stored; memcpy, for a hostile file may place it at any address.
template <class Stored>
Stored component(const std::uint8_t* at) {
  Stored value;
  std::memcpy(&value, at, sizeof value);
  return value;
}

template <class Stored>
float asFloat(const std::uint8_t* at, bool normalized) {
  const Stored value = component<Stored>(at);
  if constexpr (std::is_integral_v<Stored>)
    if (normalized) return std::max(float(value) / float(std::numeric_limits<Stored>::max()), -1.0f);
  return float(value);
}

template <class Stored>
double asNumber(const std::uint8_t* at, bool) {
  return double(component<Stored>(at));
}

template <class Stored>
std::uint32_t asIndex(const std::uint8_t* at, bool) {
  return std::uint32_t(component<Stored>(at));
}

template <class Value>
using Reader = Value (*)(const std::uint8_t*, bool);

/// f(a value of the stored type), for the type that an accessor names.
template <class F>
auto withStored(int type, F f) {
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
      return f(std::int8_t());
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return f(std::uint8_t());
    case TINYGLTF_COMPONENT_TYPE_SHORT:
      return f(std::int16_t());
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return f(std::uint16_t());
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
      return f(std::uint32_t());
    default:
      return f(float());
  }
}

Reader<float> floatReader(int type) {
  return withStored(type, [](auto stored) -> Reader<float> { return asFloat<decltype(stored)>; });
}

Reader<double> numberReader(int type) {
  return withStored(type, [](auto stored) -> Reader<double> { return asNumber<decltype(stored)>; });
}

Reader<std::uint32_t> indexReader(int type) {
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return asIndex<std::uint8_t>;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return asIndex<std::uint16_t>;
    default:
      return asIndex<std::uint32_t>;
  }
}

std::int64_t restartValue(int type) {
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return 0xff;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return 0xffff;
    default:
      return 0xffffffff;
  }
}

/// `count` elements of `components` values each, `stride` bytes apart.
template <class Value>
void readElements(const std::uint8_t* from, std::size_t count, std::size_t stride, std::size_t components, std::size_t size,
                  Reader<Value> read, bool normalized, Value* to) {
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t c = 0; c < components; ++c) *to++ = read(from + i * stride + c * size, normalized);
}

/// Null where the buffer has no bytes: readBuffers() has said so, and zeros are read.
const std::uint8_t* viewStart(const GltfFile& file, const tinygltf::BufferView& view) {
  const std::vector<std::uint8_t>& buffer = file.buffers[std::size_t(view.buffer)];
  if (buffer.empty()) return nullptr;
  return buffer.data() + view.byteOffset;
}

/// How many values an element has, and how many bytes each.
struct Element {
  std::size_t components, size;
};

Element elementOf(const tinygltf::Accessor& accessor) {
  return {std::size_t(componentCount(accessor)), std::size_t(tinygltf::GetComponentSizeInBytes(std::uint32_t(accessor.componentType)))};
}

template <class Value>
void applySparse(const GltfFile& file, const tinygltf::Model& model, const tinygltf::Accessor& accessor, Element e, Reader<Value> read,
                 std::vector<Value>& out) {
  const auto& sparse = accessor.sparse;
  const auto [components, size] = e;
  const auto indexSize = std::size_t(tinygltf::GetComponentSizeInBytes(std::uint32_t(sparse.indices.componentType)));
  const std::uint8_t* indices = viewStart(file, model.bufferViews[std::size_t(sparse.indices.bufferView)]);
  const std::uint8_t* values = viewStart(file, model.bufferViews[std::size_t(sparse.values.bufferView)]);
  if (!indices || !values) return;
  indices += sparse.indices.byteOffset;
  values += sparse.values.byteOffset;
  const auto readIndex = indexReader(sparse.indices.componentType);
  for (std::size_t i = 0; i < std::size_t(sparse.count); ++i) {
    const std::size_t element = readIndex(indices + i * indexSize, false);
    assert(element < accessor.count);  // checkIndexValues() has seen it
    readElements(values + i * components * size, 1, 0, components, size, read, accessor.normalized, &out[element * components]);
  }
}

template <class Value>
std::vector<Value> readAll(const GltfFile& file, const tinygltf::Model& model, const tinygltf::Accessor& accessor, Element e,
                           Reader<Value> read) {
  const auto [components, size] = e;
  std::vector<Value> out(accessor.count * components);  // zeros, as the specification wants where there is no view
  if (accessor.bufferView >= 0) {
    const tinygltf::BufferView& view = model.bufferViews[std::size_t(accessor.bufferView)];
    const std::size_t stride = view.byteStride != 0 ? view.byteStride : components * size;
    if (const std::uint8_t* start = viewStart(file, view))
      readElements(start + accessor.byteOffset, accessor.count, stride, components, size, read, accessor.normalized, out.data());
  }
  if (accessor.sparse.isSparse) applySparse(file, model, accessor, e, read, out);
  return out;
}

}  // namespace

int componentCount(const tinygltf::Accessor& accessor) { return tinygltf::GetNumComponentsInType(std::uint32_t(accessor.type)); }

std::vector<float> readFloats(const GltfFile& file, const tinygltf::Model& model, int accessor) {
  const tinygltf::Accessor& a = model.accessors[std::size_t(accessor)];
  return readAll<float>(file, model, a, elementOf(a), floatReader(a.componentType));
}

void checkIndexValues(const GltfFile& file, const tinygltf::Model& model) {
  for (std::size_t a = 0; a < model.accessors.size(); ++a) {
    const tinygltf::Accessor& accessor = model.accessors[a];
    if (!accessor.sparse.isSparse) continue;
    const auto& from = accessor.sparse.indices;
    const std::uint8_t* start = viewStart(file, model.bufferViews[std::size_t(from.bufferView)]);
    if (!start) continue;
    const auto size = std::size_t(tinygltf::GetComponentSizeInBytes(std::uint32_t(from.componentType)));
    for (std::size_t i = 0; i < std::size_t(accessor.sparse.count); ++i)
      if (const std::uint32_t element = indexReader(from.componentType)(start + std::size_t(from.byteOffset) + i * size, false);
          element >= accessor.count)
        throw Error(Exit::Broken, file.path, fmt::format("/accessors/{}/sparse/indices", a),
                    fmt::format("index {} is {}, there are {} elements", i, element, accessor.count), "LMC_INDEX_OUT_OF_RANGE");
  }
  // An accessor may serve any number of primitives: it is read once.
  std::vector<std::int64_t> largest(model.accessors.size(), -1);
  for (std::size_t m = 0; m < model.meshes.size(); ++m)
    for (std::size_t p = 0; p < model.meshes[m].primitives.size(); ++p) {
      const tinygltf::Primitive& primitive = model.meshes[m].primitives[p];
      const auto position = primitive.attributes.find("POSITION");
      if (primitive.indices < 0 || position == primitive.attributes.end()) continue;
      std::int64_t& most = largest[std::size_t(primitive.indices)];
      if (most < 0) {
        const std::vector<std::uint32_t> values = readIndices(file, model, primitive.indices);
        most = *std::max_element(values.begin(), values.end());
      }
      const auto refuse = [&](const std::string& what, const char* code) {
        return Error(Exit::Broken, file.path, fmt::format("/meshes/{}/primitives/{}/indices", m, p), what, code);
      };
      if (most == restartValue(model.accessors[std::size_t(primitive.indices)].componentType))
        throw refuse(fmt::format("holds the restart value {}, which glTF forbids", most), "LMC_INDEX_RESTART");
      if (const std::size_t vertices = model.accessors[std::size_t(position->second)].count; most >= std::int64_t(vertices))
        throw refuse(fmt::format("the largest index is {}, there are {} vertices", most, vertices), "LMC_INDEX_OUT_OF_RANGE");
    }
}

std::vector<std::uint32_t> readIndices(const GltfFile& file, const tinygltf::Model& model, int accessor) {
  const tinygltf::Accessor& a = model.accessors[std::size_t(accessor)];
  return readAll<std::uint32_t>(file, model, a, elementOf(a), indexReader(a.componentType));
}

std::vector<double> readNumbers(const GltfFile& file, const tinygltf::Model& model, int accessor) {
  const tinygltf::Accessor& a = model.accessors[std::size_t(accessor)];
  return readAll<double>(file, model, a, elementOf(a), numberReader(a.componentType));
}

std::vector<std::uint8_t> readBytes(const GltfFile& file, const tinygltf::Model& model, int accessor) {
  const tinygltf::Accessor& a = model.accessors[std::size_t(accessor)];
  const Element e = elementOf(a);
  return readAll<std::uint8_t>(file, model, a, {e.components * e.size, 1}, [](const std::uint8_t* at, bool) { return *at; });
}

}  // namespace lmc
