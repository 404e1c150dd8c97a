#pragma once
/// Which convex cell may see which through sequences of portals.
#include <cstdint>
#include <span>
#include <vector>

#include "libradiosity/cells.h"

namespace lmc {

/// Rows of (cells + 63)/64 words: bit b of row a is 0 only when no straight line gets from cell a to cell b through the portals.
/// `rounding_m`: what the corners of portals may be off by. Symmetric.
std::vector<std::uint64_t> portalSight(std::size_t cells, std::span<const Portal>, double rounding_m);

}  // namespace lmc
