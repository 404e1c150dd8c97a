#pragma once
/// Arithmetic in the reference's order of operations: single precision, one rounding each. glm::dot is (x x' + y y') + z z'.
#include <cfloat>
#include <cmath>
#include <glm/glm.hpp>

namespace lmc::tangent {

inline bool isNonzero(float x) { return std::abs(x) > FLT_MIN; }
inline bool isNonzero(glm::vec3 v) { return isNonzero(v.x) || isNonzero(v.y) || isNonzero(v.z); }

/// Reciprocal, then three products; a vector without any component to speak of stays as it is.
inline glm::vec3 unit(glm::vec3 v) {
  if (!isNonzero(v)) return v;
  const float inverse = 1.0f / std::sqrt(glm::dot(v, v));
  return {inverse * v.x, inverse * v.y, inverse * v.z};
}

/// The part of v in the plane of n. n is taken as it is stored, also where it is not of unit length.
inline glm::vec3 inPlane(glm::vec3 n, glm::vec3 v) {
  const float d = glm::dot(n, v);
  return {v.x - d * n.x, v.y - d * n.y, v.z - d * n.z};
}

inline glm::vec3 unitInPlane(glm::vec3 n, glm::vec3 v) { return unit(inPlane(n, v)); }

}  // namespace lmc::tangent
