#pragma once
/// The formulas of the deferred shader in C++ and double precision; docs/formulas.md shows each beside its GLSL. Written from the
/// formulas, not from the shaders, so that each can be held against the other. `Slip` gives the wrong forms, for check-shader.
#include "libscene/shading.h"
#include "shaders/slips.h"

namespace lmc::shaders {

inline double saturate(double x) { return x < 0.0 ? 0.0 : x > 1.0 ? 1.0 : x; }

/// r = L - 2 (n.L) n, L travelling towards the surface.
glm::dvec3 reflection(const glm::dvec3& travelling, const glm::dvec3& normal);

/// 1/(c + l d + q d^2) * saturate(1 - (d/range)^power); 0 where the denominator is not above 0; range 0: no window.
double classicAttenuation(const ClassicAttenuation&, double distance_m, Slip = Slip::None);
/// window/d^2, window = saturate(1 - (d/range)^4); 0 at the light itself.
double inverseSquare(double distance_m, double range_m, Slip = Slip::None);
/// KHR_lights_punctual.
double spotCone(double cosine, double cosInner, double cosOuter, Slip = Slip::None);

/// What shines [phong1975]: saturate(r.v)^power where n.l > 0, else nothing. All unit; `toLight` zero at the light itself.
double specularShare(const glm::dvec3& normal, const glm::dvec3& toLight, const glm::dvec3& toCamera, double power, Slip = Slip::None);
/// Phong power for a roughness of glTF.
double specularPower(double roughness);

glm::dvec3 colourToNormal(const glm::dvec3& colour);
glm::dvec3 normalToColour(const glm::dvec3& normal);

/// Tangent space in the world at a vertex: bitangent = cross(normal, tangent) * determinant * (sign of the world matrix).
struct TangentFrame {
  glm::dvec3 tangent, bitangent, normal;
};
TangentFrame worldFrame(const glm::dmat4& world, const glm::dvec3& normalMesh, const glm::dvec4& tangentMesh, Slip = Slip::None);

/// Light at a place: what a white surface shows [cd/m^2 or the classic model's unit].
struct LightParts {
  glm::dvec3 ambient{0.0}, diffuse{0.0}, specular{0.0};
};
struct Place {
  glm::dvec3 position_m, normal, toCamera;
  glm::dvec3 specular;  ///< of the surface
  double power = 1.0;
  bool hasMap = false;
};
LightParts lightAt(const Place&, const ShadedLight&, Slip = Slip::None);

}  // namespace lmc::shaders
