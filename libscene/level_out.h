#pragma once
/// The level as it goes out: the input with light-map marks, everything else of it kept.
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "libscene/level.h"

namespace lmc {

/// extras.lmc.lightmap of a node.
struct NodeMap {
  std::uint32_t node = 0;
  std::string uri;     ///< of the map, beside the level
  double scale = 1.0;  ///< E = texel * scale [lx]
  int texCoord = 1;
};

/// One self-contained GLB, in memory: the JSON of `level` with `maps` in its nodes' extras and `extras.lmc.baked = true` on
/// baked lights' nodes, all buffers and pictures inside. Unknown extensions, names and extras stay. Same bytes for same input.
std::vector<std::uint8_t> levelWithMaps(const std::filesystem::path& level, const LoadLimits& limits, const std::vector<NodeMap>& maps,
                                        const std::vector<std::uint32_t>& bakedLightNodes);

}  // namespace lmc
