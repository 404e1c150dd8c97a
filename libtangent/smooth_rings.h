#pragma once
/// Tangents of many vertices at once, for rings as nearly all are: some dozens of triangles at most, no quads, no side with more than two
/// triangles, no opposite tangents. Whatever is different is handed to the Fan; the bits are the same either way.
#include "libtangent/fan.h"

namespace lmc::tangent {

/// Writes the tangents of all corners round the vertices [first, last).
void computeRings(const Mesh&, const Frames&, const Rings&, const Output&, std::uint32_t first, std::uint32_t last, Remarks&);

}  // namespace lmc::tangent
