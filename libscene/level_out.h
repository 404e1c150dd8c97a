#pragma once
/// The level as it goes out: the input with its map UVs and marks, everything else of it kept.
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "libscene/level.h"

namespace lmc {

/// A light map of the level; maps of `lmc unwrap` have no file.
struct MapFile {
  std::string uri;     ///< beside the level
  double scale = 1.0;  ///< E = texel * scale [lx]
};

class GltfEdit;

/// What is written into a level.
struct LevelMarks {
  std::vector<MapFile> maps = {};                   ///< by Object::map; empty = no light was baked
  std::vector<std::uint32_t> bakedLightNodes = {};  ///< get extras.lmc.baked = true
  bool newUvs = false;                              ///< map UVs are the scene's, no longer the file's
  int side = 0;                                     ///< of the maps [texels]; with new UVs it becomes the level's lightmap.resolution
  bool asText = false;                              ///< .gltf with its buffer inside, not a GLB
  std::function<void(GltfEdit&)> more = {};         ///< what else is to be changed, last; may be empty
};

/// One self-contained GLB (or glTF text), in memory: the JSON of `level`, of which `scene` was made, with `extras.lmc.lightmap` of every
/// node that has a place in a map, all buffers and pictures inside. With new UVs meshes that several nodes show, and gpu instances, become
/// a node and a mesh each. Unknown extensions, names and extras stay. Same bytes for same input.
std::vector<std::uint8_t> levelWithMaps(const std::filesystem::path& level, const LoadLimits& limits, const Scene& scene,
                                        const LevelMarks& marks);

}  // namespace lmc
