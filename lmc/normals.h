#pragma once
#include "libscene/error.h"
#include "lmc/options.h"

namespace lmc {

/// `lmc normals`: a normal map in tangent or object space from one in the other, from heights, from a picture, or from a model with more
/// polygons. Writes a PNG, and says on stdout what is in it. Throws Error.
Exit normals(const NormalsOptions&);

}  // namespace lmc
