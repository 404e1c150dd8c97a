#include "lmc/tangents.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <optional>
#include <unordered_map>

#include "libscene/files.h"
#include "libscene/parallel.h"
#include "lmc/bake.h"
#include "lmc/progress.h"
#include "lmc/tangent_loop.h"

namespace lmc {

namespace {

using Json = GltfEdit::Json;

constexpr float kUnit = 5e-4f;         // of supplied tangents: what glTF-Validator lets pass
constexpr float kAlongNormal = 0.99f;  // cosine above which a supplied tangent says nothing about the plane

const Json* find(const Json* object, const char* key) {
  if (object == nullptr || !object->is_object()) return nullptr;
  const auto it = object->find(key);
  return it == object->end() ? nullptr : &*it;
}

/// The UVs that a texture is read with.
struct TextureUvs {
  int set = 0;
  glm::vec2 offset{0.0f}, scale{1.0f};
  float rotation_rad = 0.0f;

  /// Only moved or scaled alike in both directions: tangents do not change.
  bool isPlain() const { return rotation_rad == 0.0f && scale.x == scale.y && scale.x > 0.0f; }
  /// KHR_texture_transform: scaled, turned, moved.
  glm::vec2 at(glm::vec2 uv) const {
    const float c = std::cos(rotation_rad), s = std::sin(rotation_rad);
    const glm::vec2 p = scale * uv;
    return {c * p.x + s * p.y + offset.x, -s * p.x + c * p.y + offset.y};
  }
};

TextureUvs uvsOf(const Json& texture) {
  TextureUvs out;
  out.set = texture.value("texCoord", 0);
  const Json* transform = find(find(&texture, "extensions"), "KHR_texture_transform");
  if (transform == nullptr) return out;
  out.set = transform->value("texCoord", out.set);
  out.rotation_rad = transform->value("rotation", 0.0f);
  const auto pair = [&](const char* key, glm::vec2 otherwise) {
    const Json* v = find(transform, key);
    return v && v->is_array() && v->size() == 2 ? glm::vec2((*v)[0].get<float>(), (*v)[1].get<float>()) : otherwise;
  };
  out.offset = pair("offset", out.offset);
  out.scale = pair("scale", out.scale);
  return out;
}

/// The UVs for which a material wants tangents; nothing when it does not want any.
std::optional<TextureUvs> wishOf(const Json& json, const Json& primitive) {
  const Json *materials = find(&json, "materials"), *index = find(&primitive, "material");
  if (materials == nullptr || index == nullptr || index->get<std::size_t>() >= materials->size()) return std::nullopt;
  const Json* material = &(*materials)[index->get<std::size_t>()];
  const Json* extensions = find(material, "extensions");
  if (const Json* texture = find(material, "normalTexture")) return uvsOf(*texture);
  if (const Json* texture = find(find(extensions, "KHR_materials_clearcoat"), "clearcoatNormalTexture")) return uvsOf(*texture);
  if (const Json* anisotropy = find(extensions, "KHR_materials_anisotropy")) {
    const Json* texture = find(anisotropy, "anisotropyTexture");
    return texture ? uvsOf(*texture) : TextureUvs{};
  }
  return std::nullopt;
}

/// The arrays that a tangent::Surface looks at.
struct Corners {
  std::vector<float> positions, normals, uvs;
  std::vector<std::uint32_t> indices;

  tangent::Surface surface() const {
    const auto span3 = [](const std::vector<float>& v) { return std::span(reinterpret_cast<const glm::vec3*>(v.data()), v.size() / 3); };
    return {span3(positions), span3(normals), std::span(reinterpret_cast<const glm::vec2*>(uvs.data()), uvs.size() / 2), indices, {}};
  }
};

/// Vertices so that all corners of one have one tangent; copies stand in the order of their first use.
struct Split {
  NewVertices vertices;
  std::vector<float> tangents;  ///< 4 a vertex
};

Split split(const std::vector<std::uint32_t>& indices, const tangent::Array<tangent::CornerTangent>& corners, float sign) {
  struct Key {
    std::uint32_t word[5];
    bool operator==(const Key&) const = default;
  };
  struct Hash {
    std::size_t operator()(const Key& k) const {
      std::uint64_t h = 0;
      for (const std::uint32_t w : k.word) h = (h ^ w) * 0x9e3779b97f4a7c15u, h ^= h >> 29;
      return std::size_t(h);
    }
  };
  std::unordered_map<Key, std::uint32_t, Hash> known;
  known.reserve(indices.size() / 4);
  Split out;
  out.vertices.triangles.resize(indices.size() / 3);
  for (std::size_t c = 0; c < indices.size(); ++c) {
    const glm::vec3 t = corners[c].tangent + 0.0f;  // one zero, not two
    const float value[4] = {t.x, t.y, t.z, sign * corners[c].determinant};
    Key key{{0, 0, 0, 0, indices[c]}};
    std::memcpy(key.word, value, sizeof value);
    const auto [it, fresh] = known.try_emplace(key, std::uint32_t(out.vertices.source.size()));
    if (fresh) {
      out.vertices.source.push_back(indices[c]);
      out.tangents.insert(out.tangents.end(), value, value + 4);
    }
    out.vertices.triangles[c / 3][int(c % 3)] = it->second;
  }
  return out;
}

/// In words what is wrong with supplied tangents; empty when nothing is.
std::string faultsOf(const std::vector<float>& tangents, const std::vector<float>& normals) {
  std::size_t notFinite = 0, notUnit = 0, sign = 0, along = 0;
  for (std::size_t v = 0; v < tangents.size() / 4; ++v) {
    const glm::vec3 t(tangents[4 * v], tangents[4 * v + 1], tangents[4 * v + 2]);
    const float length = glm::length(t), w = tangents[4 * v + 3];
    if (!std::isfinite(length))
      ++notFinite;
    else if (!(std::abs(length - 1.0f) <= kUnit))
      ++notUnit;
    sign += std::abs(w) != 1.0f;
    if (3 * v + 2 < normals.size())
      along += std::abs(glm::dot(t, glm::vec3(normals[3 * v], normals[3 * v + 1], normals[3 * v + 2]))) > kAlongNormal;
  }
  std::string out;
  const auto tell = [&](std::size_t n, const char* what) {
    if (n > 0) out += fmt::format("{}{} {}", out.empty() ? "" : ", ", n, what);
  };
  tell(notFinite, "not finite");
  tell(notUnit, "not of unit length");
  tell(sign, "with a determinant that is neither +1 nor -1");
  tell(along, "along the normal");
  return out;
}

class Adder {
 public:
  Adder(GltfEdit& edit, const TangentOptions& options, const Run& run) : edit_(edit), options_(options), run_(run) {}

  PrimitiveTangents add(std::uint32_t mesh, std::uint32_t index) {
    PrimitiveTangents report;
    report.mesh = mesh;
    report.primitive = index;
    const Json primitive = edit_.json()["meshes"][mesh]["primitives"][index];
    const auto skip = [&](std::string why) {
      report.result = "skipped";
      report.why = std::move(why);
      return report;
    };
    if (const int mode = primitive.value("mode", 4); mode < 4 || mode > 6) return skip("points or lines");
    std::optional<TextureUvs> uvs = wishOf(edit_.json(), primitive);
    const Json& attributes = primitive["attributes"];
    if (attributes.contains("TANGENT") && !options_.regenerate) {
      report.result = "kept";
      report.why = faultsOf(edit_.attribute(mesh, index, "TANGENT", 4), edit_.attribute(mesh, index, "NORMAL", 3));
      return report;
    }
    if (!uvs && !options_.all) return skip("no normal map, clearcoat normal map or anisotropy in its material");
    if (!uvs) uvs.emplace();
    const std::string set = fmt::format("TEXCOORD_{}", uvs->set);
    report.uvs = fmt::format("{}{}", set, uvs->isPlain() ? "" : " transformed");
    if (!attributes.contains("POSITION")) return skip("no POSITION");
    if (!attributes.contains("NORMAL")) return skip("no NORMAL: glTF wants flat ones then, and tangents ignored");
    if (!attributes.contains(set)) return skip(fmt::format("no {}", set));
    compute(report, primitive, set, *uvs);
    return report;
  }

 private:
  void compute(PrimitiveTangents& report, Json primitive, const std::string& set, const TextureUvs& uvs) {
    Corners corners{edit_.attribute(report.mesh, report.primitive, "POSITION", 3),
                    edit_.attribute(report.mesh, report.primitive, "NORMAL", 3),
                    edit_.attribute(report.mesh, report.primitive, set.c_str(), 2),
                    {}};
    for (const glm::uvec3& t : edit_.triangles(report.mesh, report.primitive))
      corners.indices.insert(corners.indices.end(), {t.x, t.y, t.z});
    if (!uvs.isPlain())
      for (std::size_t v = 0; v + 1 < corners.uvs.size(); v += 2) {
        const glm::vec2 at = uvs.at({corners.uvs[v], corners.uvs[v + 1]});
        corners.uvs[v] = at.x, corners.uvs[v + 1] = at.y;
      }
    const tangent::Tangents got = tangentsOf(corners.surface(), run_);
    for (const tangent::MendedCorner& m : got.mended) ++report.mended[std::size_t(m.why)];
    const Split parts = split(corners.indices, got.corners, options_.greenDown ? -1.0f : 1.0f);

    primitive["attributes"].erase("TANGENT");
    Json out = edit_.withVertices(primitive, parts.vertices);
    if (!parts.vertices.source.empty()) out["attributes"]["TANGENT"] = edit_.addFloats(parts.tangents, 4);
    Json& extras = out["extras"];
    if (!extras.is_object() && !extras.is_null()) extras = Json{{"value", extras}};
    extras["lmc"]["tangents"] = {{"green", options_.greenDown ? "down" : "up"}, {"uvs", report.uvs}};
    edit_.json()["meshes"][report.mesh]["primitives"][report.primitive] = std::move(out);
    report.result = "computed";
    report.verticesBefore = corners.positions.size() / 3;
    report.verticesAfter = parts.vertices.source.size();
    report.counts = got.counts;
  }

  GltfEdit& edit_;
  const TangentOptions& options_;
  const Run& run_;
};

std::size_t sumOf(const PrimitiveTangents& p) { return std::accumulate(p.mended.begin(), p.mended.end(), std::size_t(0)); }

std::string mendedText(const PrimitiveTangents& p) {
  std::string out;
  for (int i = 0; i < tangent::kMendCount; ++i)
    if (p.mended[std::size_t(i)] > 0)
      out += fmt::format("{}{} {}", out.empty() ? "" : ", ", p.mended[std::size_t(i)], tangent::textOf(tangent::Mend(i)));
  return out;
}

Json asJson(const PrimitiveTangents& p) {
  Json out{{"mesh", p.mesh}, {"primitive", p.primitive}, {"result", p.result}};
  if (!p.why.empty()) out["why"] = p.why;
  if (p.result != "computed") return out;
  out["uvs"] = p.uvs;
  out["triangles"] = p.counts.triangles;
  out["degenerate"] = p.counts.degenerate;
  out["no_uv_area"] = p.counts.frameless;
  out["welded"] = p.counts.welded;
  out["groups"] = p.counts.groups;
  out["groups_not_parted"] = p.counts.hugeGroups;
  out["vertices_before"] = p.verticesBefore;
  out["vertices_after"] = p.verticesAfter;
  for (int i = 0; i < tangent::kMendCount; ++i) out["mended"][tangent::textOf(tangent::Mend(i))] = p.mended[std::size_t(i)];
  return out;
}

void print(const PrimitiveTangents& p) {
  const std::string place = fmt::format("/meshes/{}/primitives/{}", p.mesh, p.primitive);
  if (p.result != "computed") {
    fmt::print("{:<9} {}{}{}\n", p.result, place, p.why.empty() ? "" : ": ", p.why);
    return;
  }
  fmt::print("{:<9} {}: {} triangles by {}, {} -> {} vertices", p.result, place, p.counts.triangles, p.uvs, p.verticesBefore,
             p.verticesAfter);
  if (sumOf(p) > 0) fmt::print("; mended: {}", mendedText(p));
  if (p.counts.hugeGroups > 0) fmt::print("; {} vertices with too many opposite tangents to part", p.counts.hugeGroups);
  fmt::print("\n");
}

}  // namespace

std::vector<PrimitiveTangents> addTangents(GltfEdit& edit, const TangentOptions& options, const Run& run) {
  std::vector<PrimitiveTangents> out;
  if (!edit.json().contains("meshes")) return out;
  const std::size_t meshes = edit.json()["meshes"].size();
  Adder adder(edit, options, run);
  for (std::uint32_t m = 0; m < meshes; ++m)
    for (std::uint32_t p = 0; p < edit.json()["meshes"][m]["primitives"].size(); ++p) out.push_back(adder.add(m, p));
  return out;
}

nlohmann::ordered_json summaryOf(const std::vector<PrimitiveTangents>& all) {
  Json out;
  for (const char* result : {"computed", "kept", "skipped"}) out[result] = std::ranges::count(all, result, &PrimitiveTangents::result);
  std::size_t mended = 0;
  for (const PrimitiveTangents& p : all) mended += sumOf(p);
  out["mended_corners"] = mended;
  out["green"] = "up";
  return out;
}

Exit tangents(const TangentsOptions& options) {
  const Run run = stoppableRun(options.threads);
  GltfEdit edit(options.in, options.limits);
  edit.embedImages();
  std::vector<PrimitiveTangents> report;
  withThreads(run, [&] { report = addTangents(edit, options.how, run); });
  edit.dropUnused();
  const std::vector<std::uint8_t> bytes = isGltfText(options.out) ? edit.gltf() : edit.glb();
  writeFileWhole(options.out, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  for (const PrimitiveTangents& p : report)
    if (p.result == "kept" && !p.why.empty())
      tell(fmt::format("{}\n",
                       line("warning", options.in.string(), fmt::format("/meshes/{}/primitives/{}/attributes/TANGENT", p.mesh, p.primitive),
                            p.why + "; --regenerate makes new ones", "LMC_TANGENT")));
  if (options.json) {
    Json all{{"green", options.how.greenDown ? "down" : "up"}, {"primitives", Json::array()}};
    for (const PrimitiveTangents& p : report) all["primitives"].push_back(asJson(p));
    fmt::print("{}\n", all.dump(2));
    return Exit::Done;
  }
  for (const PrimitiveTangents& p : report) print(p);
  const auto count = [&](const char* result) { return std::ranges::count(report, result, &PrimitiveTangents::result); };
  fmt::print("{} computed, {} kept, {} skipped; green {}\n", count("computed"), count("kept"), count("skipped"),
             options.how.greenDown ? "down" : "up");
  return Exit::Done;
}

}  // namespace lmc
