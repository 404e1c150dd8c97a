#pragma once
/// The corners round each vertex, in the order of their triangles: the order in which the reference sums.
#include "libtangent/frames.h"

namespace lmc::tangent {

/// A corner of a triangle in one number.
using RingCorner = std::uint32_t;
inline RingCorner ringCorner(std::size_t triangle, std::uint32_t corner) { return RingCorner(triangle << 2 | corner); }
inline std::uint32_t triangleOf(RingCorner c) { return c >> 2; }
inline std::uint32_t cornerOf(RingCorner c) { return c & 3; }
inline constexpr std::uint32_t kNextCorner[3] = {1, 2, 0}, kPreviousCorner[3] = {2, 0, 1};

/// Rings of the triangles that are not degenerate. 2 triangles (0,1,2), (2,1,3): start = [0, 1, 3, 5, 6], corners = [0.0, 0.1, 1.1,
/// 0.2, 1.0, 1.2]
struct Rings {
  Array<std::uint32_t> start;  ///< per id, and one more
  Array<RingCorner> corners;   ///< and kAhead zeros, so that what comes may be asked for
  static constexpr std::size_t kAhead = 48;

  std::span<const RingCorner> of(std::uint32_t id) const { return {corners.data() + start[id], start[id + 1] - start[id]}; }
};

Rings ringsOf(const Mesh&, const Frames&, const Loop&);

}  // namespace lmc::tangent
