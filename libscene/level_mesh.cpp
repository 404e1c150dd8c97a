#include "libscene/level_mesh.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include <fmt/format.h>

#include "libscene/gltf_accessor.h"

namespace lmc {
namespace {

constexpr float kMaxUv = 1.0e6f;        // a step of a float is 1/16 there: no place in a picture is left
constexpr float kUnitTolerance = 0.1f;  // normalised bytes are off by 1 %, a normal that is off by 10 % was never one

int attribute(const tinygltf::Primitive& primitive, const char* name) {
  const auto it = primitive.attributes.find(name);
  return it == primitive.attributes.end() ? -1 : it->second;
}

template <int N>
std::vector<glm::vec<N, float>> readVectors(const GltfFile& file, const tinygltf::Model& model, int accessor) {
  const std::vector<float> values = readFloats(file, model, accessor);
  std::vector<glm::vec<N, float>> out(values.size() / N);
  static_assert(sizeof(glm::vec<N, float>) == N * sizeof(float));
  std::memcpy(out.data(), values.data(), out.size() * sizeof(glm::vec<N, float>));
  return out;
}

struct Place {
  const GltfFile& file;
  std::string where;  ///< of the primitive
  Error broken(std::string_view attributeName, std::string_view what, std::string_view code) const {
    return Error(Exit::Broken, file.path, where + std::string(attributeName), what, code);
  }
};

std::vector<glm::vec2> readUvs(const Place& place, const tinygltf::Model& model, int accessor, const char* name) {
  std::vector<glm::vec2> uvs = readVectors<2>(place.file, model, accessor);
  for (std::size_t v = 0; v < uvs.size(); ++v) {
    if (!std::isfinite(uvs[v].x) || !std::isfinite(uvs[v].y))
      throw place.broken(fmt::format("/attributes/{}", name), fmt::format("the UV of vertex {} is not finite", v),
                         name == std::string_view("TEXCOORD_1") ? "LMC_LIGHTMAP_UV_NOT_FINITE" : "LMC_UV_NOT_FINITE");
    if (std::abs(uvs[v].x) > kMaxUv || std::abs(uvs[v].y) > kMaxUv)
      throw place.broken(fmt::format("/attributes/{}", name), fmt::format("the UV of vertex {} is {:g}, {:g}", v, uvs[v].x, uvs[v].y),
                         "LMC_UV_OUTSIDE");
  }
  return uvs;
}

std::vector<glm::vec4> readColors(const Place& place, const tinygltf::Model& model, int accessor) {
  std::vector<glm::vec4> colors;
  if (componentCount(model.accessors[std::size_t(accessor)]) == 4) {
    colors = readVectors<4>(place.file, model, accessor);
  } else {
    for (const glm::vec3& rgb : readVectors<3>(place.file, model, accessor)) colors.emplace_back(rgb, 1.0f);
  }
  for (std::size_t v = 0; v < colors.size(); ++v) {
    if (!std::isfinite(colors[v].x + colors[v].y + colors[v].z + colors[v].w))
      throw place.broken("/attributes/COLOR_0", fmt::format("the colour of vertex {} is not finite", v), "LMC_COLOR_NOT_FINITE");
    colors[v] = glm::clamp(colors[v], 0.0f, 1.0f);
  }
  return colors;
}

/// Those that say nothing, zero or not finite, become zero vectors.
std::vector<glm::vec4> readTangents(const GltfFile& file, const tinygltf::Model& model, int accessor) {
  std::vector<glm::vec4> tangents = readVectors<4>(file, model, accessor);
  for (glm::vec4& t : tangents) {
    const float length = glm::length(glm::vec3(t));
    t = length > 0.0f && std::isfinite(length) ? glm::vec4(glm::vec3(t) / length, t.w < 0.0f ? -1.0f : 1.0f) : glm::vec4(0.0f);
  }
  return tangents;
}

std::vector<glm::uvec3> trianglesOf(int mode, std::span<const std::uint32_t> corners) {
  std::vector<glm::uvec3> out;
  const auto n = std::uint32_t(corners.size());
  switch (mode) {
    case TINYGLTF_MODE_TRIANGLE_STRIP:
      // glTF 2.0, section 3.7.2.1: p_i = {v_i, v_(i + 1 + i % 2), v_(i + 2 - i % 2)}.
      for (std::uint32_t i = 0; i + 2 < n; ++i) out.emplace_back(corners[i], corners[i + 1 + i % 2], corners[i + 2 - i % 2]);
      break;
    case TINYGLTF_MODE_TRIANGLE_FAN:
      for (std::uint32_t i = 1; i + 1 < n; ++i) out.emplace_back(corners[i], corners[i + 1], corners[0]);
      break;
    default:
      out.reserve(n / 3);
      for (std::uint32_t i = 0; i + 2 < n; i += 3) out.emplace_back(corners[i], corners[i + 1], corners[i + 2]);
  }
  return out;
}

std::vector<std::uint32_t> cornersOf(const GltfFile& file, const tinygltf::Model& model, const tinygltf::Primitive& primitive,
                                     std::size_t vertices) {
  if (primitive.indices < 0) {
    std::vector<std::uint32_t> corners(vertices);
    for (std::size_t i = 0; i < vertices; ++i) corners[i] = std::uint32_t(i);
    return corners;
  }
  return readIndices(file, model, primitive.indices);  // in range: checkIndexValues()
}

glm::dvec3 twiceArea(const Part& part, glm::uvec3 t) {
  const glm::dvec3 a(part.positions[t.x]), b(part.positions[t.y]), c(part.positions[t.z]);
  return glm::cross(b - a, c - a);
}

std::uint64_t dropDegenerate(Part& part) {
  return std::erase_if(part.triangles, [&](glm::uvec3 t) { return !(glm::length(twiceArea(part, t)) >= kMinTwiceArea); });
}

template <class T>
void unshare(std::vector<T>& values, std::span<const glm::uvec3> triangles) {
  if (values.empty()) return;
  std::vector<T> out;
  out.reserve(triangles.size() * 3);
  for (const glm::uvec3& t : triangles)
    for (int c = 0; c < 3; ++c) out.push_back(values[t[c]]);
  values = std::move(out);
}

void makeFlat(Part& part) {
  for (const glm::uvec3& t : part.triangles)
    for (int c = 0; c < 3; ++c) part.source.push_back(t[c]);
  unshare(part.positions, part.triangles);
  unshare(part.uv0, part.triangles);
  unshare(part.uv1, part.triangles);
  unshare(part.mapUv, part.triangles);
  unshare(part.colors, part.triangles);
  part.normals.resize(part.positions.size());
  for (std::uint32_t i = 0; i < part.triangles.size(); ++i) {
    part.triangles[i] = glm::uvec3(3 * i, 3 * i + 1, 3 * i + 2);
    const glm::vec3 normal(glm::normalize(twiceArea(part, part.triangles[i])));
    for (int c = 0; c < 3; ++c) part.normals[3 * i + std::uint32_t(c)] = normal;
  }
}

/// Unit normals; the bad ones become the area-weighted mean of the faces at their vertex.
void mendNormals(Part& part, PartReport& report) {
  std::vector<bool> bad(part.normals.size(), false), opposite(part.normals.size(), false);
  bool any = false;
  for (std::size_t v = 0; v < part.normals.size(); ++v) {
    const double length = glm::length(glm::dvec3(part.normals[v]));
    if (std::isfinite(length) && length > 1e-12) {
      if (std::abs(length - 1.0) > kUnitTolerance) ++report.normalsNotUnit;
      part.normals[v] = glm::vec3(glm::dvec3(part.normals[v]) / length);
    } else {
      bad[v] = any = true;
    }
  }
  // One that looks away from every face at its vertex would make a front dark in full light.
  std::vector<bool> agrees(part.normals.size(), false), used(part.normals.size(), false);
  for (const glm::uvec3& t : part.triangles)
    for (int c = 0; c < 3; ++c) {
      used[t[c]] = true;
      if (!bad[t[c]] && glm::dot(glm::dvec3(part.normals[t[c]]), twiceArea(part, t)) >= 0.0) agrees[t[c]] = true;
    }
  for (std::size_t v = 0; v < part.normals.size(); ++v)
    if (used[v] && !bad[v] && !agrees[v]) {
      bad[v] = opposite[v] = any = true;
      ++report.normalsOpposite;
    }
  if (!any) return;
  std::vector<glm::dvec3> sums(part.normals.size(), glm::dvec3(0.0));
  for (const glm::uvec3& t : part.triangles)
    for (int c = 0; c < 3; ++c) sums[t[c]] += twiceArea(part, t);
  for (std::size_t v = 0; v < part.normals.size(); ++v) {
    if (!bad[v]) continue;
    report.normalsRebuilt += used[v] && !opposite[v];
    const double length = glm::length(sums[v]);
    part.normals[v] = length > 0.0 ? glm::vec3(sums[v] / length) : glm::vec3(0.0f, 1.0f, 0.0f);
  }
}

}  // namespace

bool hasTriangles(const tinygltf::Primitive& primitive) {
  return primitive.mode != TINYGLTF_MODE_POINTS && primitive.mode != TINYGLTF_MODE_LINE && primitive.mode != TINYGLTF_MODE_LINE_LOOP &&
         primitive.mode != TINYGLTF_MODE_LINE_STRIP && attribute(primitive, "POSITION") >= 0;
}

std::uint64_t triangleCount(const tinygltf::Model& model, const tinygltf::Primitive& primitive) {
  if (!hasTriangles(primitive)) return 0;
  const int corners = primitive.indices >= 0 ? primitive.indices : attribute(primitive, "POSITION");
  const std::uint64_t count = model.accessors[std::size_t(corners)].count;
  const bool list = primitive.mode == TINYGLTF_MODE_TRIANGLES || primitive.mode == -1;
  return list ? count / 3 : count < 3 ? 0 : count - 2;
}

std::vector<glm::uvec3> readTriangles(const GltfFile& file, const tinygltf::Model& model, const tinygltf::Primitive& primitive) {
  const auto vertices = model.accessors[std::size_t(attribute(primitive, "POSITION"))].count;
  return trianglesOf(primitive.mode, cornersOf(file, model, primitive, vertices));
}

Part readPart(const GltfFile& file, const tinygltf::Model& model, std::size_t mesh, std::size_t primitive, const PartWish& wish,
              PartReport& report) {
  const tinygltf::Primitive& from = model.meshes[mesh].primitives[primitive];
  const Place place{file, fmt::format("/meshes/{}/primitives/{}", mesh, primitive)};
  Part part;
  part.positions = readVectors<3>(file, model, attribute(from, "POSITION"));
  for (std::size_t v = 0; v < part.positions.size(); ++v)
    if (const glm::vec3 p = part.positions[v]; !std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z))
      throw place.broken("/attributes/POSITION", fmt::format("vertex {} is not finite", v), "LMC_POSITION_NOT_FINITE");
  part.triangles = readTriangles(file, model, from);
  if (const int a = attribute(from, "TEXCOORD_0"); a >= 0) part.uv0 = readUvs(place, model, a, "TEXCOORD_0");
  if (const int a = attribute(from, "TEXCOORD_1"); a >= 0) part.uv1 = readUvs(place, model, a, "TEXCOORD_1");
  if (wish.mapSet == 1)
    part.mapUv = part.uv1;
  else if (const std::string name = fmt::format("TEXCOORD_{}", wish.mapSet); attribute(from, name.c_str()) >= 0)
    part.mapUv = readUvs(place, model, attribute(from, name.c_str()), name.c_str());
  if (const int a = attribute(from, "COLOR_0"); a >= 0) part.colors = readColors(place, model, a);
  report.degenerate += dropDegenerate(part);
  if (const int a = attribute(from, "NORMAL"); a >= 0) {
    part.normals = readVectors<3>(file, model, a);
    mendNormals(part, report);
    if (const int t = attribute(from, "TANGENT"); t >= 0 && wish.tangents) part.tangents = readTangents(file, model, t);
  } else {
    makeFlat(part);
  }
  return part;
}

glm::dmat4 Trs::matrix() const {
  glm::dmat4 m = glm::mat4_cast(glm::dot(rotation, rotation) > 0.0 ? glm::normalize(rotation) : glm::dquat(1.0, 0.0, 0.0, 0.0));
  for (int axis = 0; axis < 3; ++axis) m[axis] *= scale[axis];
  m[3] = glm::dvec4(translation, 1.0);
  return m;
}

std::vector<Trs> readInstances(const GltfFile& file, const tinygltf::Model& model, std::size_t node) {
  const Json* instancing = extension(file.json["nodes"][node], "EXT_mesh_gpu_instancing");
  const Json* attributes = instancing ? member(*instancing, "attributes") : nullptr;
  if (!attributes) return {};
  const auto values = [&](const char* key) {
    const Json* accessor = member(*attributes, key);
    return accessor ? readFloats(file, model, accessor->get<int>()) : std::vector<float>();
  };
  const std::vector<float> t = values("TRANSLATION"), r = values("ROTATION"), s = values("SCALE");
  std::vector<Trs> out(std::max({t.size() / 3, r.size() / 4, s.size() / 3}));
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (!t.empty()) out[i].translation = {t[3 * i], t[3 * i + 1], t[3 * i + 2]};
    if (!r.empty()) out[i].rotation = glm::dquat(r[4 * i + 3], r[4 * i], r[4 * i + 1], r[4 * i + 2]);
    if (!s.empty()) out[i].scale = {s[3 * i], s[3 * i + 1], s[3 * i + 2]};
  }
  return out;
}

namespace {

/// Every "texCoord" in a material, extensions' textures included.
void addTexCoords(const Json& json, std::vector<std::uint32_t>& sets) {
  if (json.is_object())
    if (const Json* set = member(json, "texCoord"); set && set->is_number_unsigned()) sets.push_back(set->get<std::uint32_t>());
  if (json.is_structured())
    for (const Json& child : json) addTexCoords(child, sets);
}

}  // namespace

std::uint32_t freeTexCoord(const Json& gltf, const Json& primitive) {
  std::vector<std::uint32_t> sets;
  const Json* materials = member(gltf, "materials");
  const auto add = [&](const Json& of) {
    const Json* material = member(of, "material");
    if (materials && material && material->is_number_unsigned() && material->get<std::size_t>() < materials->size())
      addTexCoords((*materials)[material->get<std::size_t>()], sets);
  };
  add(primitive);
  if (const Json* variants = extension(primitive, "KHR_materials_variants"))
    if (const Json* mappings = member(*variants, "mappings"); mappings && mappings->is_array())
      for (const Json& mapping : *mappings) add(mapping);
  std::uint32_t n = 1;
  while (std::ranges::find(sets, n) != sets.end()) ++n;
  return n;
}

}  // namespace lmc
