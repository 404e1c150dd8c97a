#include "libradiosity/pools.h"

#include <algorithm>

namespace lmc {

namespace {

constexpr double kHopeless = 2.0;  // of the least variance that there can be

double raysAt(const Pool& p, double kappa) {
  return std::clamp(kappa * std::pow(p.influence / p.points * p.variance1, kRaysOfVariance), p.rays, double(Pool::kMostRays));
}

}  // namespace

void giveRays(std::vector<Pool>& pools, std::span<const std::uint32_t> ids, double allowed) {
  const auto noise = [&](double kappa) {
    double sum = 0.0, texels = 0.0;
    for (const std::uint32_t i : ids) {
      sum += pools[i].noise2At(raysAt(pools[i], kappa));
      texels += pools[i].texels;
    }
    return sum / texels;
  };
  double lo = 1e-6, hi = 1e12;
  // A point that cannot be mended by all the rays that it may have is no reason to give as many to the others.
  allowed = std::max(allowed, kHopeless * noise(hi));
  if (noise(lo) <= allowed) {
    hi = lo;
  } else {
    for (int step = 0; step < 60; ++step) {
      const double mid = std::sqrt(lo * hi);
      (noise(mid) <= allowed ? hi : lo) = mid;
    }
  }
  for (const std::uint32_t i : ids) pools[i].wanted = std::max(pools[i].wanted, raysAt(pools[i], hi));
}

}  // namespace lmc
