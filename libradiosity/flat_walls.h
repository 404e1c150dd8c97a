#pragma once
/// The level's large flat surfaces that no light passes: what closes rooms.
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include "libscene/polygon2.h"
#include "libscene/scene.h"

namespace lmc {

/// All opaque triangles of one plane, whichever way they face.
struct FlatWall {
  glm::dvec3 normal{0.0};  ///< unit
  double offset_m = 0.0;   ///< dot(normal, place)
  glm::dvec3 u{0.0}, v{0.0};
  std::vector<std::array<glm::dvec2, 3>> triangles;         ///< in (u, v), counter-clockwise
  std::vector<std::pair<glm::dvec2, glm::dvec2>> outlines;  ///< edges of them that no neighbour of the same side shares
  double area_m2 = 0.0;                                     ///< sum over triangles

  glm::dvec2 flat(const glm::dvec3& x) const { return {glm::dot(u, x), glm::dot(v, x)}; }
  glm::dvec3 place(const glm::dvec2& p) const { return offset_m * normal + p.x * u + p.y * v; }
};

/// The largest ones. A triangle belongs to a wall when its corners are within `rounding_m` of the plane, which is fitted to all of them.
/// Holes of Mask materials, Blend and transmission, and what casts no shadow, make no wall. Bounded work: of a level of very many
/// triangles only the walls about its largest ones are found.
std::vector<FlatWall> flatWalls(const Scene&, double rounding_m);

/// What of a convex polygon (counter-clockwise in (u, v)) the wall leaves open, in convex parts. Parts narrower than `width_m` are left
/// out. `work` counts edges looked at; above `mostWork` the whole polygon is open.
std::vector<Polygon2> openParts(const FlatWall&, const Polygon2&, double width_m, std::uint64_t& work, std::uint64_t mostWork);

/// The smallest distance of two parallel lines that hold a convex polygon between them, one of them along an edge.
double widthOf(const Polygon2&);

}  // namespace lmc
