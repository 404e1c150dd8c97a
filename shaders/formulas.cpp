#include "shaders/formulas.h"

#include <algorithm>
#include <cmath>

#include "libscene/constants.h"
#include "shaders/view.h"

namespace lmc::shaders {

glm::dvec3 reflection(const glm::dvec3& travelling, const glm::dvec3& normal) {
  return travelling - 2.0 * glm::dot(normal, travelling) * normal;
}

double classicAttenuation(const ClassicAttenuation& a, double d, Slip slip) {
  const double quadratic = slip == Slip::QuadraticPrecedence && a.range > 0.0 ? 1.0 : a.quadratic;
  const double denominator = a.constant + a.linear * d + quadratic * d * d;
  if (!(denominator > 0.0)) return 0.0;
  if (!(a.range > 0.0) || slip == Slip::WindowMissing || slip == Slip::ClassicWindowMissing) return 1.0 / denominator;
  if (slip == Slip::WindowPowerOutside) return std::pow(saturate(1.0 - d / a.range), a.power) / denominator;
  return saturate(1.0 - std::pow(d / a.range, a.power)) / denominator;
}

double inverseSquare(double d, double range_m, Slip slip) {
  if (!(d * d > 0.0)) return 0.0;
  const bool windowed = range_m > 0.0 && slip != Slip::WindowMissing && slip != Slip::PhysicalWindowMissing;
  const double window = windowed ? saturate(1.0 - std::pow(d / range_m, 4.0)) : 1.0;
  return slip == Slip::InverseDistance ? window / d : window / (d * d);
}

double spotCone(double cosine, double cosInner, double cosOuter, Slip slip) {
  constexpr double kLeastWidth = 0.001;  // KHR_lights_punctual
  if (slip == Slip::ConeMissing) return 1.0;
  const double s = saturate((cosine - cosOuter) / std::max(kLeastWidth, cosInner - cosOuter));
  return slip == Slip::ConeNotSquared ? s : s * s;
}

double specularShare(const glm::dvec3& normal, const glm::dvec3& toLight, const glm::dvec3& toCamera, double power, Slip slip) {
  if (!(glm::dot(normal, toLight) > 0.0) && slip != Slip::SpecularUngated) return 0.0;
  if (slip == Slip::HalfVector) return std::pow(saturate(glm::dot(normal, glm::normalize(toLight + toCamera))), power);
  glm::dvec3 r = reflection(-toLight, normal);
  if (slip == Slip::ReflectionSign) r = -r;
  if (slip == Slip::ReflectArgumentsSwapped) r = reflection(normal, -toLight);
  return std::pow(saturate(glm::dot(r, toCamera)), power);
}

double specularPower(double roughness) {
  // A GGX lobe of alpha = roughness^2 is about as wide as a Blinn lobe of 2/alpha^2 - 2, and that as a Phong lobe of a quarter of it.
  constexpr double kLeastAlpha = 0.03, kLeast = 1.0, kMost = 256.0;
  const double alpha = std::max(roughness * roughness, kLeastAlpha);
  return std::clamp(0.5 / (alpha * alpha) - 0.5, kLeast, kMost);
}

glm::dvec3 colourToNormal(const glm::dvec3& colour) { return 2.0 * colour - 1.0; }
glm::dvec3 normalToColour(const glm::dvec3& normal) { return 0.5 * normal + 0.5; }

TangentFrame worldFrame(const glm::dmat4& world, const glm::dvec3& normalMesh, const glm::dvec4& tangentMesh, Slip slip) {
  const glm::dmat3 linear(world);
  TangentFrame out;
  out.normal = glm::normalize((slip == Slip::NormalByWorldMatrix ? linear : normalMatrix(world)) * normalMesh);
  const glm::dvec3 tangent = linear * glm::dvec3(tangentMesh);
  out.tangent = glm::normalize(tangent - glm::dot(out.normal, tangent) * out.normal);
  double sign = tangentMesh.w;
  if (slip == Slip::DeterminantFlipped) sign = -sign;
  if (slip == Slip::DeterminantIgnored) sign = 1.0;
  if (slip != Slip::MirrorIgnored && glm::determinant(linear) < 0.0) sign = -sign;
  out.bitangent = sign * glm::cross(out.normal, out.tangent);
  return out;
}

namespace {

/// From candela or lux to what a white surface shows.
double physicalUnit(Slip slip) {
  switch (slip) {
    case Slip::PiMissing:
      return 1.0;
    case Slip::PiTwice:
      return 1.0 / (kPi * kPi);
    case Slip::PiInverted:
      return kPi;
    default:
      return 1.0 / kPi;
  }
}

}  // namespace

LightParts lightAt(const Place& place, const ShadedLight& shaded, Slip slip) {
  const Light& light = shaded.light;
  glm::dvec3 toLight = -light.direction;
  double attenuation = light.classic ? 1.0 : physicalUnit(slip);
  if (light.kind != Light::Kind::Directional) {
    const glm::dvec3 way = light.position_m - place.position_m;
    const double d = glm::length(way);
    toLight = d > 0.0 ? way / d : glm::dvec3(0.0);
    attenuation *= light.classic ? classicAttenuation(*light.classic, d, slip) : inverseSquare(d, light.range_m, slip);
  }
  if (light.kind == Light::Kind::Spot) attenuation *= spotCone(-glm::dot(toLight, light.direction), light.cosInner, light.cosOuter, slip);

  LightParts out;
  const double power = shaded.specularPower > 0.0 ? shaded.specularPower : place.power;
  const glm::dvec3 shine = slip == Slip::SpecularMapIgnored ? glm::dvec3(1.0) : place.specular;
  out.specular = (slip == Slip::SpecularUnattenuated ? 1.0 : attenuation) * shaded.specularIntensity *
                 specularShare(place.normal, toLight, place.toCamera, power, slip) * shine * glm::dvec3(shaded.specular);
  if (shaded.baked && place.hasMap && slip != Slip::StaticTwice) return out;
  const double cosine = glm::dot(place.normal, toLight);
  out.ambient = glm::dvec3(shaded.ambient);
  const double lit = slip == Slip::DiffuseUnclamped ? cosine : slip == Slip::DiffuseAbsolute ? std::abs(cosine) : saturate(cosine);
  out.diffuse = lit * attenuation * glm::dvec3(light.intensity);
  return out;
}

}  // namespace lmc::shaders
