#pragma once
/// Map UVs of one level carried over to another that shows the same surfaces, cut into other meshes and triangles.
#include <string>
#include <vector>

#include "libscene/scene.h"

namespace lmc {

struct TransferReport {
  std::vector<std::uint32_t> matched;                            ///< objects of the level that got their UVs
  std::vector<std::pair<std::uint32_t, std::string>> unmatched;  ///< those that did not, and why
};

/// Gives every object of `to` that receives light the map UVs that `from` has at the same places: on surfaces that face the same way and
/// lie within `tolerance` of the level's size, of an object of the same name where several do. An object stays as it is when less than 99.9
/// % of its area is found, when its corners lie in more than one map, or when a triangle's corners are not those of one chart (by more than
/// half a texel of maps of `side`).
TransferReport transferUvs(const Scene& from, int side, Scene& to, double tolerance);

}  // namespace lmc
