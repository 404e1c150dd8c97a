#pragma once
/// Skies whose radiance depends on elevation alone, and the illuminance that they give without a level in between.
#include <span>

#include "libradiosity/form_factor.h"

namespace lmc {

enum class SkyKind {
  Uniform,      ///< one radiance
  MoonSpencer,  ///< overcast, (1 + 2 sin g)/3 of the zenith's [moon1942]
  CieOvercast,  ///< CIE general sky type 1, (1 + 4 exp(-0.7/sin g))/(1 + 4 exp(-0.7)) [cie-s011]
};

/// Radiance at the elevation g, zenith = 1; 0 below the horizon.
double skyRadiance(SkyKind, double sinElevation);

/// E of the open sky over black ground on an element tilted from the horizontal, zenith radiance 1 [lx]. Rings of one elevation: their
/// part in front of the element in closed form, the sum over elevations by quadrature.
double skyIlluminance(SkyKind, double tilt_rad);

/// E of the part of the sky that is seen through a polygon, zenith radiance 1 [lx]; what lies below the horizon (`up`, unit) or behind the
/// element counts nothing. Openings have no front.
double skyThroughPolygon(SkyKind, const glm::dvec3& position, const glm::dvec3& normal, std::span<const glm::dvec3> polygon,
                         const glm::dvec3& up);

}  // namespace lmc
