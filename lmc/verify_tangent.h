#pragma once
/// Reference vectors of tangents through libtangent.
#include <string>
#include <vector>

#include "lmc/tspace.h"

namespace lmc {

/// A corner that is not as it must be, and in what.
struct WrongCorner {
  std::size_t corner;
  std::string what;
};
struct TangentVerdict {
  std::size_t judged = 0;  ///< corners
  std::size_t wrong = 0;
  std::vector<WrongCorner> first;  ///< of the wrong ones, ten at most
  std::string summary;             ///< one line
};

/// Exact mode: equal in bits, +0 = -0, where the ambiguity is 0 to 8; finite at 9; the sign alone at 10, where either of two values is
/// right.
TangentVerdict judgeExact(const TangentVectors&, const tangent::ReferenceTangents&);

/// Safe mode: finite, unit to 1e-5, orthogonal to unit normals to 1e-3, determinant +1 or -1, and as in exact mode but where that is not
/// finite, zero, the filler or not orthogonal.
TangentVerdict judgeSafe(const TangentVectors&, const tangent::ReferenceTangents&, const tangent::Tangents&);

}  // namespace lmc
