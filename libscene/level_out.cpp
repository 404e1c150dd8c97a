#include "libscene/level_out.h"

#include <fmt/format.h>

#include <bit>
#include <map>
#include <unordered_map>

#include "libscene/gltf_edit.h"
#include "libscene/rng.h"

namespace lmc {
namespace {

using Json = GltfEdit::Json;

/// extras.lmc of a node, made where it is not there. Extras that are no object have no room for it and are kept under "value".
Json& lmcOf(Json& node) {
  Json& extras = node["extras"];
  if (!extras.is_object() && !extras.is_null()) extras = Json{{"value", extras}};
  return extras["lmc"];
}

Json lightmapOf(const Object& o, const LevelMarks& marks) {
  Json out = Json::object();
  if (!marks.maps.empty()) {
    out["uri"] = marks.maps[o.map].uri;
    out["scale"] = marks.maps[o.map].scale;
  }
  out["texCoord"] = o.texCoord;
  if (o.map > 0) out["map"] = o.map;
  return out;
}

/// A primitive with the map UVs that the scene has for the object.
class NewPrimitive {
 public:
  NewPrimitive(GltfEdit& edit, const Scene& scene, const Object& o) : edit_(edit), scene_(scene), o_(o) {}

  Json make(const Json& from) {
    const std::vector<glm::uvec3> all = edit_.triangles(o_.mesh, o_.primitive);
    // The scene has left out triangles without area; they stay in the file.
    std::uint32_t next = o_.firstTriangle;
    const std::uint32_t end = o_.firstTriangle + o_.triangleCount;
    std::vector<std::uint32_t> loose;
    for (const glm::uvec3& t : all) {
      glm::uvec3 corners = t;
      const auto source = [&](int k) { return scene_.sourceVertex[scene_.triangles[next][k]]; };
      if (next < end && source(0) == t.x && source(1) == t.y && source(2) == t.z) {
        const glm::uvec3 v = scene_.triangles[next++];
        corners = {copy(t.x, scene_.mapUv[v.x]), copy(t.y, scene_.mapUv[v.y]), copy(t.z, scene_.mapUv[v.z])};
      } else if (next < end && source(0) == t.x && source(1) == t.z && source(2) == t.y) {  // of a mirrored node
        const glm::uvec3 v = scene_.triangles[next++];
        corners = {copy(t.x, scene_.mapUv[v.x]), copy(t.y, scene_.mapUv[v.z]), copy(t.z, scene_.mapUv[v.y])};
      } else {
        loose.push_back(std::uint32_t(out_.triangles.size()));
      }
      out_.triangles.push_back(corners);
    }
    for (const std::uint32_t i : loose)
      for (int k = 0; k < 3; ++k) {
        std::uint32_t& v = out_.triangles[i][k];
        const auto any = anyCopy_.find(v);
        v = any != anyCopy_.end() ? any->second : copy(v, glm::vec2(0.0f));
      }
    Json base = from;
    base["attributes"].erase(fmt::format("TEXCOORD_{}", o_.texCoord));  // not to be copied in vain
    Json out = edit_.withVertices(base, out_);
    const std::uint32_t uv = edit_.addFloats({&uv_[0].x, 2 * uv_.size()}, 2);
    // glTF wants the sets below to be there.
    for (std::uint32_t n = 0; n <= o_.texCoord; ++n)
      if (Json& a = out["attributes"]; n == o_.texCoord || !a.contains(fmt::format("TEXCOORD_{}", n)))
        a[fmt::format("TEXCOORD_{}", n)] = uv;
    return out;
  }

 private:
  std::uint32_t copy(std::uint32_t source, glm::vec2 uv) {
    auto& same = known_[combine(source, std::uint64_t(std::bit_cast<std::uint32_t>(uv.x)) << 32 | std::bit_cast<std::uint32_t>(uv.y))];
    for (const std::uint32_t n : same)
      if (out_.source[n] == source && uv_[n] == uv) return n;
    same.push_back(std::uint32_t(out_.source.size()));
    out_.source.push_back(source);
    uv_.push_back(uv);
    anyCopy_.try_emplace(source, same.back());
    return same.back();
  }

  GltfEdit& edit_;
  const Scene& scene_;
  const Object& o_;
  NewVertices out_;
  std::vector<glm::vec2> uv_;
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> known_;
  std::unordered_map<std::uint32_t, std::uint32_t> anyCopy_;  // of a source vertex
};

/// A mesh of its own for each node and instance, with the scene's map UVs.
void writeUvs(GltfEdit& edit, const Scene& scene, const LevelMarks& marks) {
  Json& json = edit.json();
  const Json meshes = json["meshes"];                                                  // as they came in
  std::map<std::uint32_t, std::map<std::uint32_t, std::vector<const Object*>>> nodes;  // node, instance
  for (const Object& o : scene.objects)
    if (o.receive && o.triangleCount > 0) nodes[o.node][o.instance].push_back(&o);
  for (const auto& [node, instances] : nodes) {
    std::vector<Json> places = edit.expandInstances(node);
    const auto mesh = json["nodes"][node]["mesh"].get<std::size_t>();
    const auto meshFor = [&](const std::vector<const Object*>& objects) {
      Json own = meshes[mesh];
      for (const Object* o : objects)
        own["primitives"][o->primitive] = NewPrimitive(edit, scene, *o).make(meshes[mesh]["primitives"][o->primitive]);
      json["meshes"].push_back(std::move(own));
      return json["meshes"].size() - 1;
    };
    if (places.empty()) {
      json["nodes"][node]["mesh"] = meshFor(instances.begin()->second);
      continue;
    }
    json["nodes"][node].erase("mesh");
    const std::string name = json["nodes"][node].value("name", meshes[mesh].value("name", std::string("instance")));
    for (std::uint32_t i = 0; i < places.size(); ++i) {
      Json child = {{"name", fmt::format("{}[{}]", name, i)}};
      child.update(places[i]);
      const auto it = instances.find(i);
      child["mesh"] = it != instances.end() ? meshFor(it->second) : mesh;
      if (it != instances.end()) lmcOf(child)["lightmap"] = lightmapOf(*it->second[0], marks);
      json["nodes"].push_back(std::move(child));
      json["nodes"][node]["children"].push_back(json["nodes"].size() - 1);
    }
  }
  const std::size_t active = json.value("scene", std::size_t(0));
  if (json.contains("scenes") && active < json["scenes"].size()) lmcOf(json["scenes"][active])["lightmap"]["resolution"] = marks.side;
}

}  // namespace

std::vector<std::uint8_t> levelWithMaps(const std::filesystem::path& level, const LoadLimits& limits, const Scene& scene,
                                        const LevelMarks& marks) {
  GltfEdit edit(level, limits);
  edit.embedImages();
  edit.refuseChanged(scene);
  if (marks.newUvs) writeUvs(edit, scene, marks);
  Json& json = edit.json();
  for (const Object& o : scene.objects)
    if (o.receive && o.triangleCount > 0 && json["nodes"].at(o.node).contains("mesh"))
      lmcOf(json["nodes"][o.node])["lightmap"] = lightmapOf(o, marks);
  for (const std::uint32_t node : marks.bakedLightNodes) lmcOf(json["nodes"].at(node))["baked"] = true;
  if (marks.more) marks.more(edit);
  if (marks.newUvs || marks.more) edit.dropUnused();
  return marks.asText ? edit.gltf() : edit.glb();
}

}  // namespace lmc
