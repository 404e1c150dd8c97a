#pragma once
/// What a bake will hold at most, told before the work from counts alone, and how it keeps to a limit without changing a byte.
#include <algorithm>

#include "lmc/options.h"

namespace lmc {

struct MemoryPlan {
  std::uint64_t limit_bytes = 0;   ///< --memory, or what the machine has
  std::uint64_t least_bytes = 0;   ///< below it the bake is refused
  std::uint64_t wanted_bytes = 0;  ///< what it takes at full speed, stored rays apart
  std::uint64_t held_bytes = 0;    ///< to be resident at most: the limit, or without --memory what a bake takes without being asked
  std::uint64_t rays_bytes = 0;    ///< left for stored rays while they are needed
  std::uint64_t tiles_bytes = 0;   ///< for tiles that are kept between stages
  std::uint64_t texels_bytes = 0;  ///< of what is wanted, texels' state
  /// Texels' state lies in files, and the field's is put together at each hit.
  bool paged() const { return held_bytes < wanted_bytes; }
  /// What the bake will hold at most, and what of it lies in files beside that.
  std::uint64_t peak_bytes() const { return std::min(held_bytes, wanted_bytes); }
  std::uint64_t disk_bytes() const { return paged() ? texels_bytes : 0; }
};

/// Squares of the patch size in a level's area; up to three times as many patches come of it. Their number goes with 1/goal, for their
/// error is of second order in their size. Direct light at hits comes from the map's texels, so that they carry second bounces only.
double squaresFor(double goal);

/// `side`: of the map [texels]; `bounce`: whether patches are made; `seams`: whether they are looked for.
MemoryPlan planMemory(const Scene&, const BakeOptions&, int side, int maps, bool bounce, bool seams, std::uint64_t machine_bytes);

/// "512M": K, M, G, T are powers of 1024, without one it is bytes. nullopt when it is no size of at least 1 byte.
std::optional<std::uint64_t> bytesOf(std::string_view text);
/// The size in whole M, rounded up: what bytesOf takes.
std::string sizeText(std::uint64_t bytes);
/// "960M of memory", or with files "960M of memory and 3340M of disk".
std::string sizeText(const MemoryPlan&);

}  // namespace lmc
