#pragma once
/// One chart of a surface laid flat: isometric where the chart is flat, else conformal in the least-squares sense (CGAL only in
/// flatten.cpp).
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "libscene/surface.h"

namespace lmc {

/// Faces of a surface that hang together by edges, with their places in the plane.
struct FlatChart {
  std::vector<std::uint32_t> faces;  ///< of the surface
  std::vector<glm::uvec3> corners;   ///< one a face, into uv_m
  std::vector<glm::dvec2> uv_m;      ///< faces counter-clockwise; the area of the whole is the area on the surface
  double stretch = 1.0;              ///< L2 of [sander2001]; 1 = isometric
};

/// L2 stretch of [sander2001], equation 2, over triangles, when the map is scaled to keep the whole area: 1 = isometric. Infinite for a
/// triangle with an area on the surface and none in the plane.
double stretchL2(std::span<const glm::dvec3> positions, std::span<const glm::uvec3> triangles, std::span<const glm::dvec2> uv,
                 std::span<const glm::uvec3> corners);

/// Triangles of a map that have inner points in common with one before them, in order; all of it must run counter-clockwise or have no
/// area. Ends with the first one when `first` is set. Exact for coordinates that are whole numbers below 2^29.
std::vector<std::uint32_t> overlapping(std::span<const glm::i64vec2> uv, std::span<const glm::uvec3> corners, bool first);

/// Twice the area, positive counter-clockwise.
inline std::int64_t twiceArea(std::span<const glm::i64vec2> uv, glm::uvec3 t) {
  const glm::i64vec2 b = uv[t.y] - uv[t.x], c = uv[t.z] - uv[t.x];
  return b.x * c.y - b.y * c.x;
}

/// Scales a chart to the area that it has on the surface, moves it to the origin and finds its stretch; false where it folds over itself
/// or stretches by more than `maxStretch`.
bool acceptChart(FlatChart&, const Surface&, double maxStretch);

/// Disjoint sets of a surface's faces: for each face its set, and its number in it.
struct FaceSets {
  std::vector<std::uint32_t> set, number;
};

/// The chart of these faces, a set of `sets`, or nothing when it would fold over itself or stretch by more than `maxStretch`. Edges to
/// faces of other sets are borders.
std::optional<FlatChart> flatten(const Surface&, std::span<const std::uint32_t> faces, const FaceSets& sets, double maxStretch);

/// The chart of a single face.
FlatChart flattenFace(const Surface&, std::uint32_t face);

}  // namespace lmc
