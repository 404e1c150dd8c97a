#pragma once
/// Gathered texels that lie near each other, and how rays are shared among them: as few as bring the noise of some of them below a limit.
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "libscene/scene.h"

namespace lmc {

inline constexpr double kSobolExponent = 0.7;  ///< error ~ rays^-0.7 behind clutter (measured 0.68..0.72, methods/radiosity.md section 2)
/// Rays of the least sum for a given sum of variance * rays^(-2 kSobolExponent) go with variance to this power (Lagrange).
inline constexpr double kRaysOfVariance = 1.0 / (1.0 + 2.0 * kSobolExponent);

/// Gathered texels of a chart that lie near each other and speak for as many others: one estimate of variance, one number of rays.
struct Pool {
  static constexpr std::uint32_t kMostRays = 16384;  ///< each half, of one texel
  std::uint32_t object = kNone, chart = kNone;
  double points = 0.0, texels = 0.0;  ///< gathered; spoken for
  double rays = 0.0;                  ///< each half, mean over the points
  double variance1 = 0.0;             ///< of one ray's worth: variance of a point is variance1 * rays^(-2 kSobolExponent) [lx^2]
  double influence = 0.0;             ///< sum over points and texels of squared weights: noise of the texels is influence * variance
  double illuminance = 0.0;           ///< mean over the texels spoken for, direct light included [lx]
  double bounced = 0.0;               ///< the part of it that comes by bounces
  glm::dvec3 drift{0.0};              ///< mean change when light is read from patches of twice the size [lx]
  double wanted = 0.0;                ///< rays each half after the next round
  /// Of the texels spoken for, with so many rays each half: sum [lx^2].
  double noise2At(double each) const { return influence * variance1 * std::pow(each, -2.0 * kSobolExponent); }
};

/// Raises `wanted` of some pools (`ids`, at least one) so that the variance of their texels, in the mean, is at most `allowed` [lx^2], with
/// the fewest rays: N ~ (influence/points * variance1)^kRaysOfVariance, between what a pool has and the most. No less than twice the
/// variance that the most rays everywhere would leave is asked for.
void giveRays(std::vector<Pool>&, std::span<const std::uint32_t> ids, double allowed);

}  // namespace lmc
