#pragma once
/// Punctual lights as formulas; design.md section 1, KHR_lights_punctual.
#include "libscene/scene.h"

namespace lmc {

/// Distance window of KHR_lights_punctual: saturate(1 - (d/range)^4), not squared; 1 without a range.
double rangeWindow(double distance_m, double range_m);
/// Cone of KHR_lights_punctual: saturate((cos - cosOuter)/max(0.001, cosInner - cosOuter))^2.
double spotCone(double cosAngle, double cosInner, double cosOuter);
/// The same by the angles: keeps its digits in cones so narrow that the cosines of their angles hardly differ.
double spotConeByAngle(double angle_rad, double inner_rad, double outer_rad);
/// Light that a spot of 1 cd sends out, int of the cone over all directions [lm].
double spotFlux_lm(double inner_rad, double outer_rad);
/// 1/(c + l d + q d^2) * saturate(1 - (d/range)^power); finite for every input: a zero denominator gives 0 light, range 0 no window.
double attenuation(const ClassicAttenuation&, double distance_m);

/// What a light gives to a place when nothing is in between.
struct Incoming {
  glm::dvec3 illuminance{0.0};  ///< E [lx] about `normal`; 0 when the light is behind it, out of range or outside the cone
  glm::dvec3 towards{0.0};      ///< from the place to the light [m]; directional: unit
  bool endless = false;         ///< the way to the light does not end (directional)
};
Incoming incoming(const Light&, const glm::dvec3& position_m, const glm::dvec3& normal);

/// False only when the light cannot reach any point of the sphere: out of range, or outside the cone.
bool mayReach(const Light&, const glm::dvec3& centre_m, double radius_m);

}  // namespace lmc
