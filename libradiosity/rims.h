#pragma once
/// Rims: a solid that stands on a surface which goes on below it (a crate, a wall on an uncut floor) leaves texels that lie partly in it.
/// As means over their squares they are darker than the surface before it, and bilinear lookups at its foot show that as a rim.
#include <cstdint>
#include <span>

#include "libradiosity/light_map.h"

namespace lmc {

inline constexpr std::uint8_t kBurialPlaces = 64;

/// Of each covered texel, how many of kBurialPlaces places on it lie in no solid (burial.h). The first 4, or 16 where a neighbour is
/// brighter, tell where all of them do; none where none of 4 does, where it and its neighbours are dark, and where no chart is.
/// Purpose::Exposure.
TexelArray<std::uint8_t> freePlaces(const LightMapValues&, const LightMap&, const Scene&, const TexelMap&, const Tracer&, const Run&);

struct RimResult {
  std::uint64_t texels = 0;                       ///< covered ones that were given another value
  double largestMove_lx = 0.0, rmsMove_lx = 0.0;  ///< of a channel; over all covered texels and channels
};

/// Texels half or more of which is free of solids get the light of that part: the mean over its share, but no more than the brightest free
/// neighbour has. Those of which less is free, and those where a solid thinner than they are parts free neighbours from each other, get the
/// mean of neighbours that are free and touch each other, the darkest such group: what a lookup in the dark reads stays dark. Those without
/// any keep what they have: no lookup before the solid reads them.
RimResult fillRims(LightMapValues&, const LightMap&, std::span<const std::uint8_t> free);

}  // namespace lmc
