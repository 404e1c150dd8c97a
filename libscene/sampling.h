#pragma once
/// Unit square to directions.
#include <algorithm>
#include <cmath>
#include <glm/glm.hpp>

#include "libscene/constants.h"

namespace lmc {

/// Two unit vectors that complete `n` to a right-handed frame, without a branch on its direction that could flip between neighbours
/// [duff2017], eq. 3 in spirit.
inline glm::dmat3 frameAbout(const glm::dvec3& n) {
  const double sign = std::copysign(1.0, n.z);
  const double a = -1.0 / (sign + n.z), b = n.x * n.y * a;
  return {glm::dvec3(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), glm::dvec3(b, sign + n.y * n.y * a, -n.y), n};
}

/// Density cos/pi about +z: E = integral of L cos = pi/N sum L_k, because the cosines cancel. The concentric map of [shirley1997] keeps
/// squares of the unit square compact on the disc, and so the stratification of the samples.
inline glm::dvec3 cosineHemisphere(glm::vec2 u) {
  const float a = 2.0f * u.x - 1.0f, b = 2.0f * u.y - 1.0f;
  float r = 0.0f, phi = 0.0f;
  if (a * a > b * b) {
    r = a;
    phi = float(kPi / 4.0) * (b / a);
  } else if (b != 0.0f) {
    r = b;
    phi = float(kPi / 2.0) - float(kPi / 4.0) * (a / b);
  }
  return {double(r * std::cos(phi)), double(r * std::sin(phi)), std::sqrt(std::max(0.0, 1.0 - double(r) * double(r)))};
}

}  // namespace lmc
