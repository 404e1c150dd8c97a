#pragma once
/// occlusionTexture of materials: openness in the red channel, strength 1, on the UV set of the map.
#include <span>
#include <vector>

#include "libscene/gltf_edit.h"

namespace lmc {

/// A node whose surface is in an openness map.
struct OcclusionUse {
  std::uint32_t node = 0;
  std::uint32_t picture = 0;   ///< into the list of pictures
  std::uint32_t texCoord = 0;  ///< TEXCOORD_n
};

/// The nodes that extras.lmc.lightmap gives a place.
std::vector<OcclusionUse> usesOfLightmaps(const GltfEdit::Json&);

/// Gives the materials of these nodes an occlusionTexture, one of the pictures (objects for "images"). Materials that other nodes have too
/// become two, and so do meshes. A material that has one keeps it; returns how many do.
std::size_t addOcclusionTextures(GltfEdit&, const std::vector<GltfEdit::Json>& pictures, std::span<const OcclusionUse>);

}  // namespace lmc
