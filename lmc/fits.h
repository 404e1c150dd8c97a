#pragma once
/// Curves through points by least squares (Ceres only in fits.cpp).
#include <optional>
#include <span>

#include "libscene/scene.h"

namespace lmc {

struct FallOffPlace {
  double distance_m = 0.0, value = 0.0;  ///< value: what is left of the light there
};

struct AttenuationFit {
  ClassicAttenuation attenuation;
  double rms = 0.0;           ///< of the relative differences, each against max(the value wished, 1 % of the mean of all)
  double largest = 0.0;       ///< of them
  double largestAt_m = 0.0;   ///< where that is
  double largestValue = 0.0;  ///< difference of the values there
};

/// Constant, linear and quadratic (none negative) and the power of 1/(c + l d + q d^2) * saturate(1 - (d/range)^power), so that relative
/// differences are least (see AttenuationFit::rms). Places beyond the range count, too: the curve is 0 there. Needs four places.
AttenuationFit fitAttenuation(std::span<const FallOffPlace> wished, double range_m);

/// y = factor * x^exponent
struct PowerLaw {
  double factor = 0.0, exponent = 0.0;
  double exponentError = 0.0;  ///< standard error, from how far the points lie off the line
  double rms = 0.0;            ///< of log y
};
struct CurvePoint {
  double x = 0.0, y = 0.0;
};
/// In logarithms; points that are not above 0 are left out. Nothing where x of the rest is all the same, or there are fewer than two.
std::optional<PowerLaw> fitPowerLaw(std::span<const CurvePoint>);

}  // namespace lmc
