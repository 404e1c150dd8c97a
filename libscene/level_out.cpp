#include "libscene/level_out.h"

#include "libscene/gltf_edit.h"

namespace lmc {
namespace {

using Json = GltfEdit::Json;

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

}  // namespace

std::vector<std::uint8_t> levelWithMaps(const std::filesystem::path& level, const LoadLimits& limits, const std::vector<NodeMap>& maps,
                                        const std::vector<std::uint32_t>& bakedLightNodes) {
  GltfEdit edit(level, limits);
  edit.embedImages();
  mark(edit.json(), maps, bakedLightNodes);
  return edit.glb();
}

}  // namespace lmc
