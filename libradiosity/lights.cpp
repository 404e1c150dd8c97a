#include "libradiosity/lights.h"

#include <algorithm>
#include <cmath>

#include "libscene/constants.h"

namespace lmc {

double rangeWindow(double distance_m, double range_m) {
  if (range_m <= 0.0) return 1.0;
  const double q = distance_m / range_m;
  return std::clamp(1.0 - q * q * q * q, 0.0, 1.0);
}

double spotCone(double cosAngle, double cosInner, double cosOuter) {
  const double s = std::clamp((cosAngle - cosOuter) / std::max(0.001, cosInner - cosOuter), 0.0, 1.0);
  return s * s;
}

namespace {

constexpr double kLeastConeWidth = 0.001;  // of the cosines, KHR_lights_punctual

double cosineDifference(double small_rad, double large_rad) {
  return 2.0 * std::sin(0.5 * (large_rad + small_rad)) * std::sin(0.5 * (large_rad - small_rad));
}

}  // namespace

double spotConeByAngle(double angle_rad, double inner_rad, double outer_rad) {
  const double width = std::max(kLeastConeWidth, cosineDifference(inner_rad, outer_rad));
  const double s = std::clamp(cosineDifference(angle_rad, outer_rad) / width, 0.0, 1.0);
  return s * s;
}

double spotFlux_lm(double inner_rad, double outer_rad) {
  // 2 pi int s^2 dcos, s = min(1, x/width), x = cos - cos outer from 0 to 1 - cos outer.
  const double width = std::max(kLeastConeWidth, cosineDifference(inner_rad, outer_rad));
  const double all = cosineDifference(0.0, outer_rad), ramp = std::min(all, width);
  return 2.0 * kPi * (ramp * ramp * ramp / (3.0 * width * width) + (all - ramp));
}

double attenuation(const ClassicAttenuation& a, double d) {
  const double denominator = a.constant + a.linear * d + a.quadratic * d * d;
  if (!(denominator > 0.0)) return 0.0;
  // The difference is saturated, not the power: beyond the range the window stays 0.
  const double window = a.range > 0.0 ? std::clamp(1.0 - std::pow(d / a.range, a.power), 0.0, 1.0) : 1.0;
  return window / denominator;
}

Incoming incoming(const Light& light, const glm::dvec3& position_m, const glm::dvec3& normal) {
  Incoming in;
  if (light.kind == Light::Kind::Directional) {
    in.endless = true;
    in.towards = -light.direction;
    const double cosine = std::max(0.0, glm::dot(normal, in.towards));
    in.illuminance = (light.classic ? kPi : 1.0) * cosine * glm::dvec3(light.intensity);
    return in;
  }
  in.towards = light.position_m - position_m;
  const double d2 = glm::dot(in.towards, in.towards);
  const double d = std::sqrt(d2);
  if (!(d > 0.0)) return in;  // a place on the lamp itself has no direction to it
  const double cosine = glm::dot(normal, in.towards) / d;
  if (cosine <= 0.0) return in;
  double factor = cosine;
  if (light.classic)
    factor *= kPi * attenuation(*light.classic, d);
  else
    factor *= rangeWindow(d, light.range_m) / d2;
  if (light.kind == Light::Kind::Spot) factor *= spotCone(-glm::dot(light.direction, in.towards) / d, light.cosInner, light.cosOuter);
  in.illuminance = factor * glm::dvec3(light.intensity);
  return in;
}

bool mayReach(const Light& light, const glm::dvec3& centre_m, double radius_m) {
  if (light.kind == Light::Kind::Directional) return true;
  const glm::dvec3 to = centre_m - light.position_m;
  const double d = glm::length(to);
  const double range = light.classic ? light.classic->range : light.range_m;
  if (range > 0.0 && d - radius_m > range) return false;
  if (light.kind == Light::Kind::Spot && d > radius_m) {
    // The sphere is seen under half angle asin(r/d) about its centre; it misses the cone when even its nearest edge is outside.
    const double toCentre = std::acos(std::clamp(glm::dot(light.direction, to) / d, -1.0, 1.0));
    if (toCentre - std::asin(std::min(1.0, radius_m / d)) > std::acos(std::clamp(light.cosOuter, -1.0, 1.0)) + 1e-9) return false;
  }
  return true;
}

}  // namespace lmc
