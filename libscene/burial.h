#pragma once
/// How a place on a surface lies among the level's solids.
#include <cstdint>
#include <span>

#include "libscene/tracer.h"

namespace lmc {

enum class Lie : std::uint8_t {
  Unknown,
  Free,    ///< something leaves the level from here
  Buried,  ///< inside a solid that stands on the surface: half or more of what is met are insides of solids, for others may pierce it
  Closed   ///< in a closed room
};

inline constexpr std::size_t kLieRays = RayFan::kRays;

/// Told by rays over the hemisphere of the place, which starts them.
Lie lieOf(const Tracer&, std::span<const Ray, kLieRays>, Purpose);

}  // namespace lmc
