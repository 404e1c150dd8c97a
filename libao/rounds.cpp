#include "libao/rounds.h"

#include <algorithm>
#include <cmath>

namespace lmc::ao {

namespace {

constexpr double kExponent = 0.7;      // error ~ rays^-0.7 behind clutter (measured 0.68..0.72)
constexpr double kMostRays = 16384.0;  // each half
// Of the error asked for. The main round stops short of it: how fast the error falls is known better after it.
constexpr std::array<double, 3> kAims{1.25, 0.96, 0.95};
constexpr double kLocalLimit = 4.0;    // times the error asked for, of any pool: no speckles where few texels are hard
constexpr double kWorthARound = 1.02;  // times the rays that are there: below it, a correction is not begun
constexpr double kDark = 0.01;

/// Squares of half the difference of the halves: what the mean of both is off by, in the mean over many entries.
struct Spread {
  double cosine2 = 0.0, uniform2 = 0.0;
  void add(const Sums& s) {
    if (s.middle == Lie::Buried) return;  // 0, whatever its rays say
    const double c = 0.5 * (s.cosine(0) - s.cosine(1)), u = 0.5 * (s.uniform(0) - s.uniform(1));
    cosine2 += c * c;
    uniform2 += u * u;
  }
  double larger() const { return std::max(cosine2, uniform2); }
};

double varianceAt(const Pool& p, double rays) { return p.variance * std::pow(rays / p.rays, -2.0 * kExponent); }

std::vector<Pool> makePools(std::span<const Sums> sums, std::span<const std::uint32_t> poolOf, std::uint32_t count) {
  std::vector<Pool> pools(count);
  std::vector<Spread> spreads(count);
  std::vector<double> open(count, 0.0);
  for (std::size_t i = 0; i < sums.size(); ++i) {
    if (poolOf[i] == kNone) continue;
    Pool& p = pools[poolOf[i]];
    ++p.entries;
    p.rays += sums[i].rays;
    spreads[poolOf[i]].add(sums[i]);
    open[poolOf[i]] += sums[i].uniform();
  }
  for (std::size_t k = 0; k < pools.size(); ++k) {
    Pool& p = pools[k];
    if (p.entries == 0) continue;
    const double rays = 2.0 * p.rays;
    p.rays /= p.entries;
    p.variance = spreads[k].larger() / p.entries;
    // All open or all dark in so many rays of neighbours: a gap (or an occluder) that all of them missed is next to be met by one ray in
    // rays + 2 (Laplace's rule). So many rays are evidence; few are not.
    if (open[k] == 0.0 || open[k] == double(p.entries)) p.variance = std::max(p.variance, 1.0 / (rays + 2.0) / (2.0 * p.rays));
  }
  return pools;
}

double rmsError(std::span<const Sums> sums, std::span<const std::uint32_t> poolOf) {
  Spread all;
  double entries = 0.0;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    if (poolOf[i] == kNone) continue;
    all.add(sums[i]);
    entries += 1.0;
  }
  return entries > 0.0 ? std::sqrt(all.larger() / entries) : 0.0;
}

std::uint32_t wholeBlocks(double rays) { return std::uint32_t(std::ceil(rays / kBlock)) * kBlock; }

}  // namespace

bool giveOut(std::vector<Pool>& pools, double error) {
  double entries = 0.0, have = 0.0, want = 0.0;
  for (const Pool& p : pools) entries += p.entries;
  // Minimal sum of N for a given sum of variance * (N/rays)^(-2a): N ~ (variance rays^(2a))^(1/(1 + 2a)) (Lagrange).
  const auto raysAt = [&](const Pool& p, double kappa) {
    return std::clamp(kappa * std::pow(p.variance * std::pow(p.rays, 2.0 * kExponent), 1.0 / (1.0 + 2.0 * kExponent)), p.rays, kMostRays);
  };
  const auto meanVariance = [&](double kappa) {
    double sum = 0.0;
    for (const Pool& p : pools)
      if (p.entries > 0) sum += p.entries * varianceAt(p, raysAt(p, kappa));
    return sum / entries;
  };
  double kappa = 0.0;
  if (const double allowed = error * error; meanVariance(0.0) > allowed) {
    double low = 1e-6, high = 1e9;
    for (int step = 0; step < 60; ++step) {
      kappa = std::sqrt(low * high);
      (meanVariance(kappa) <= allowed ? high : low) = kappa;
    }
    kappa = high;
  }
  for (Pool& p : pools) {
    if (p.entries == 0) continue;
    const double local = p.rays * std::pow(std::sqrt(p.variance) / (kLocalLimit * error), 1.0 / kExponent);
    p.wanted = std::max(raysAt(p, kappa), std::min(local, kMostRays));
    have += p.entries * p.rays;
    want += p.entries * p.wanted;
  }
  return want > kWorthARound * have;
}

double foretellRays(const Options& options, std::span<const Sums> sums, std::span<const std::uint32_t> poolOf, std::uint32_t poolCount,
                    const CastAll& cast) {
  const std::uint32_t each = options.rays > 0 ? wholeBlocks(0.5 * options.rays) : kPilotRays;
  TexelArray<std::uint32_t> wanted(sums.size());
  for (std::size_t i = 0; i < sums.size(); ++i)
    if (poolOf[i] != kNone) wanted[i] = each;
  cast(wanted, 0.0, 1.0);
  std::vector<Pool> pools = makePools(sums, poolOf, poolCount);
  if (options.rays == 0) giveOut(pools, kAims[1] * options.error);
  double rays = 0.0;
  for (const Pool& p : pools)
    if (p.entries > 0) rays += 2.0 * p.entries * wholeBlocks(options.rays > 0 ? p.rays : p.wanted);
  return rays;
}

Openness castInRounds(const Options& options, std::span<const Sums> sums, std::span<const std::uint32_t> poolOf, std::uint32_t poolCount,
                      const CastAll& cast) {
  Openness out;
  TexelArray<std::uint32_t> wanted(sums.size());
  const std::uint32_t first = options.rays > 0 ? wholeBlocks(0.5 * options.rays) : kPilotRays;
  for (std::size_t i = 0; i < sums.size(); ++i)
    if (poolOf[i] != kNone) wanted[i] = first;
  double done = options.rays > 0 ? 1.0 : 0.15;
  out.rays = cast(wanted, 0.0, done);
  std::vector<Pool> pools = makePools(sums, poolOf, poolCount);
  for (std::size_t k = 0; k < kAims.size() && options.rays == 0; ++k) {
    if (k > 0 && rmsError(sums, poolOf) <= options.error) break;
    if (!giveOut(pools, kAims[k] * options.error) && k > 0) break;
    for (std::size_t i = 0; i < sums.size(); ++i)
      if (poolOf[i] != kNone)
        wanted[i] = sums[i].middle == Lie::Buried ? sums[i].rays : std::max(sums[i].rays, wholeBlocks(pools[poolOf[i]].wanted));
    const double next = k == 0 ? 0.7 : 0.5 * (1.0 + done);
    out.rays += cast(wanted, done, next);
    done = next;
    pools = makePools(sums, poolOf, poolCount);
  }

  for (TexelArray<float>* a : {&out.cosine, &out.uniform, &out.error}) *a = TexelArray<float>(sums.size());
  double dark = 0.0;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    if (poolOf[i] == kNone) continue;
    ++out.asked;
    if (sums[i].middle != Lie::Buried) {
      out.cosine[i] = float(std::clamp(sums[i].cosine(), 0.0, 1.0));
      out.uniform[i] = float(std::clamp(sums[i].uniform(), 0.0, 1.0));
      out.error[i] = float(std::sqrt(varianceAt(pools[poolOf[i]], sums[i].rays)));
    }
    dark += out.cosine[i] < float(kDark);
  }
  out.darkShare = out.asked > 0 ? dark / double(out.asked) : 0.0;
  out.rmsError = rmsError(sums, poolOf);
  return out;
}

}  // namespace lmc::ao
