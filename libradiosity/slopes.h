#pragma once
/// How light changes over patches. A patch's mean alone makes what is seen beyond the nearest part of a wall too dark by what that part is
/// darker; with a slope for each patch the error is of second order in its size.
#include <utility>
#include <vector>

#include "libradiosity/field.h"
#include "libscene/texel_array.h"
#include "libscene/texels.h"

namespace lmc {

/// Where the map's texels lie on patches.
struct TexelPatches {
  TexelPatches(const Scene&, const PatchMesh&, const TexelMap&, const Run&);
  TexelArray<std::uint32_t> patch;   ///< under each texel's middle; kNone = not covered, or it reflects nothing
  TexelArray<glm::vec3> position_m;  ///< of the texel's middle
};

/// Groups of patches, for means over them: group 0.. of each patch.
struct PatchGroups {
  std::vector<std::uint32_t> of;
  std::uint32_t count = 0;
};

PatchGroups singlePatches(const PatchMesh&);

/// A value that changes over groups.
struct Sloped {
  std::vector<Rgb> mean;
  std::vector<glm::mat3> slope;  ///< change per metre, a column a channel
};

/// Slopes by least squares from the groups (or single patches) beside each other, which are those that meet in neighbour texels of a chart.
class Slopes {
 public:
  Slopes(const PatchMesh&, const DirectMap&, const TexelPatches&, const PatchGroups&);

  /// Area means of a patch value over the groups; patches without area have their first one's.
  std::vector<Rgb> means(const std::vector<Rgb>& ofPatches) const;
  Sloped of(std::vector<Rgb> means) const;
  /// The value at a texel's middle, between nothing and twice the mean. The texel must have a patch.
  Rgb at(const Sloped&, std::size_t texel) const;

 private:
  struct Moment {
    glm::dmat3 inverse{0.0};  // of the sum of (to neighbour)(to neighbour)^T
    bool known = false;
  };

  const PatchMesh& mesh_;
  const TexelPatches& texels_;
  const PatchGroups& groups_;
  std::vector<glm::dvec3> centre_m_;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> pairs_;
  std::vector<Moment> moments_;
};

}  // namespace lmc
