#pragma once
/// How many rays each texel or vertex gets: fixed at the end of a round from what all have found, in a fixed order.
#include <span>

#include "libao/hemisphere.h"

namespace lmc::ao {

inline constexpr std::uint32_t kPilotRays = 16;  ///< each half

/// Neighbours that share one estimate of variance.
struct Pool {
  std::uint32_t entries = 0;
  double rays = 0.0;      ///< each half, in the mean
  double variance = 0.0;  ///< of an entry's value, the larger of both weightings, when it has this many rays
  double wanted = 0.0;    ///< rays each half
};

/// Casts until each entry's halves have so many rays, which are multiples of kBlock; `from` and `to`: share of the stage's work. Returns
/// the rays cast.
using CastAll = std::function<std::uint64_t(std::span<const std::uint32_t> wanted, double from, double to)>;

/// A pilot; then what Options::error asks for, given out so that the fewest rays reach it; then at most two corrections. `poolOf`: one an
/// entry, below `poolCount`; kNone = it is not asked for. `sums` is what `cast` adds to.
Openness castInRounds(const Options&, std::span<const Sums> sums, std::span<const std::uint32_t> poolOf, std::uint32_t poolCount,
                      const CastAll& cast);

/// The rays that castInRounds is going to cast, both halves, from its pilot alone; where their number is given, from all of them.
double foretellRays(const Options&, std::span<const Sums> sums, std::span<const std::uint32_t> poolOf, std::uint32_t poolCount,
                    const CastAll& cast);

/// Sets Pool::wanted so that the predicted RMS over all entries is `error`, and nowhere above four times that, with the fewest rays. False
/// when no pool wants more than it has.
bool giveOut(std::vector<Pool>&, double error);

}  // namespace lmc::ao
