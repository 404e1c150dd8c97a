#pragma once
/// Safe mode: what takes the place of tangents that do not serve.
#include "libtangent/output.h"

namespace lmc::tangent {

/// Mends every corner of the list in the output, and gives it back by ascending corner. Of a corner that no triangle with a frame reaches,
/// the determinant comes from the other corners of its face, else from its triangle, else it is +1.
std::vector<MendedCorner> mendAll(const Surface&, const Mesh&, const Frames&, const Output&, std::vector<Bad>, const Loop&);

}  // namespace lmc::tangent
