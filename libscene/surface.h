#pragma once
/// The triangles of one object as a surface: which of them border on which, however their vertices were split.
#include <array>
#include <cstdint>
#include <vector>

#include "libscene/scene.h"

namespace lmc {

struct Surface {
  std::vector<glm::dvec3> positions_m;                   ///< one for all vertices at a place
  std::vector<glm::uvec3> triangles;                     ///< into positions_m, in the object's order
  std::vector<glm::dvec3> normals;                       ///< unit, of the faces
  std::vector<glm::dvec3> centres_m;                     ///< of the faces
  std::vector<double> areas_m2;                          ///< of the faces
  std::vector<std::array<std::uint32_t, 3>> neighbours;  ///< across the edge from corner k to corner k + 1; kNone at borders and creases
};

/// Faces meet where they share an edge in opposite directions and no third face has it. A crease is an edge where the faces turn by more
/// than 30 degrees and the shading normals differ, or by more than 75 degrees in any case.
Surface surfaceOf(const Scene&, const Object&);

}  // namespace lmc
