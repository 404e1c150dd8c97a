#pragma once
/// How light changes over patches. A patch's mean alone makes what is seen beyond the nearest part of a wall too dark by what that part is
/// darker; with a slope for each patch the error is of second order in its size.
#include <utility>
#include <vector>

#include "libradiosity/field.h"
#include "libscene/texels.h"

namespace lmc {

/// Slopes by least squares from the patches beside each other, which are those that meet in neighbour texels of a chart.
class Slopes {
 public:
  Slopes(const Scene&, const PatchMesh&, const DirectMap&, const TexelMap&, const Run&);

  /// The patch under each texel's middle; kNone = not covered, or it reflects nothing.
  const std::vector<std::uint32_t>& patchOf() const { return patchOf_; }

  /// A value of patches at the texels' middles: mean and slope, between nothing and twice the mean. None where patchOf() is kNone.
  std::vector<Rgb> overTexels(const std::vector<Rgb>& ofPatches) const;

 private:
  struct Moment {
    glm::dmat3 inverse{0.0};  // of the sum of (to neighbour)(to neighbour)^T
    bool known = false;
  };
  glm::dvec3 towards(std::uint32_t a, std::uint32_t b) const { return mesh_.patches[b].centre_m - mesh_.patches[a].centre_m; }

  const PatchMesh& mesh_;
  std::vector<std::uint32_t> patchOf_;
  std::vector<glm::vec3> offset_m_;  // from the patch's centre to the texel's middle
  std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs_;
  std::vector<Moment> moments_;
};

}  // namespace lmc
