#include "lmc/occlusion_texture.h"

#include <fmt/format.h>

#include <map>
#include <set>
#include <tuple>

namespace lmc {

namespace {

using Json = GltfEdit::Json;
constexpr std::size_t kNoMaterial = std::size_t(-1);

/// Appends to an array of the file and gives the number.
std::size_t append(Json& json, const char* array, Json value) {
  json[array].push_back(std::move(value));
  return json[array].size() - 1;
}

class Adder {
 public:
  Adder(GltfEdit& edit, const std::vector<Json>& pictures) : json_(edit.json()), pictures_(pictures) {}

  std::size_t add(std::span<const OcclusionUse> uses) {
    std::map<std::size_t, std::size_t> shown;  // mesh: by how many nodes
    for (const Json& node : json_["nodes"])
      if (node.contains("mesh")) ++shown[node["mesh"].get<std::size_t>()];
    std::map<std::tuple<std::size_t, std::uint32_t, std::uint32_t>, std::vector<std::uint32_t>> nodes;  // mesh, picture, UV set
    for (const OcclusionUse& u : uses)
      if (const Json& node = json_["nodes"].at(u.node); node.contains("mesh"))
        nodes[{node["mesh"].get<std::size_t>(), u.picture, u.texCoord}].push_back(u.node);
    for (const auto& [key, users] : nodes) {
      const auto& [mesh, picture, texCoord] = key;
      std::size_t own = mesh;
      if (users.size() < shown[mesh]) {
        own = append(json_, "meshes", Json(json_["meshes"][mesh]));
        for (const std::uint32_t n : users) json_["nodes"][n]["mesh"] = own;
        shown[mesh] -= users.size();
      }
      for (std::size_t p = 0; p < json_["meshes"][own]["primitives"].size(); ++p) addTo(own, p, picture, texCoord);
    }
    return kept_.size();
  }

 private:
  void addTo(std::size_t mesh, std::size_t p, std::uint32_t picture, std::uint32_t texCoord) {
    // Looked up each time: a new array in the file moves what is there.
    const auto primitive = [&]() -> Json& { return json_["meshes"][mesh]["primitives"][p]; };
    if (!primitive()["attributes"].contains(fmt::format("TEXCOORD_{}", texCoord))) return;
    const std::size_t material = primitive().value("material", kNoMaterial);
    if (material != kNoMaterial && json_["materials"].at(material).contains("occlusionTexture")) {
      kept_.insert(material);
      return;
    }
    const auto [known, fresh] = materials_.try_emplace({material, picture, texCoord}, 0);
    if (fresh) {
      Json own = material != kNoMaterial ? Json(json_["materials"][material]) : Json::object();
      own["occlusionTexture"] = Json::object({{"index", textureOf(picture)}, {"texCoord", texCoord}});
      known->second = append(json_, "materials", std::move(own));
    }
    primitive()["material"] = known->second;
  }

  std::size_t textureOf(std::uint32_t picture) {
    const auto [known, fresh] = textures_.try_emplace(picture, 0);
    if (fresh) {
      constexpr int kLinear = 9729, kClampToEdge = 33071;  // OpenGL's names
      if (!sampler_)
        sampler_ = append(json_, "samplers",
                          Json::object({{"magFilter", kLinear}, {"minFilter", kLinear}, {"wrapS", kClampToEdge}, {"wrapT", kClampToEdge}}));
      const std::size_t image = append(json_, "images", pictures_.at(picture));
      known->second = append(json_, "textures", Json::object({{"sampler", *sampler_}, {"source", image}}));
    }
    return known->second;
  }

  Json& json_;
  const std::vector<Json>& pictures_;
  std::optional<std::size_t> sampler_;
  std::map<std::uint32_t, std::size_t> textures_;
  std::map<std::tuple<std::size_t, std::uint32_t, std::uint32_t>, std::size_t> materials_;
  std::set<std::size_t> kept_;
};

}  // namespace

std::vector<OcclusionUse> usesOfLightmaps(const Json& json) {
  std::vector<OcclusionUse> out;
  for (std::uint32_t n = 0; json.contains("nodes") && n < json["nodes"].size(); ++n) {
    const Json place = json["nodes"][n].value("/extras/lmc/lightmap"_json_pointer, Json());
    if (place.is_object()) out.push_back({n, place.value("map", 0u), place.value("texCoord", 1u)});
  }
  return out;
}

std::size_t addOcclusionTextures(GltfEdit& edit, const std::vector<Json>& pictures, std::span<const OcclusionUse> uses) {
  return uses.empty() ? 0 : Adder(edit, pictures).add(uses);
}

}  // namespace lmc
