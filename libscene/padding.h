#pragma once
/// Which covered texel each texel outside the charts repeats, so that a bilinear lookup in a chart never mixes in another one.
#include <cstdint>
#include <span>
#include <vector>

#include "libscene/charts.h"
#include "libscene/run.h"
#include "libscene/scene.h"
#include "libscene/texel_array.h"

namespace lmc {

/// Texels around charts that repeat a covered one: lookups stay inside on two mip levels.
inline constexpr int kPadding = 4;

struct Padding {
  TexelArray<std::uint32_t> from;  ///< one a texel: the covered texel whose value it shows, itself where covered; kNone = it shows nothing
  /// Texels, in order, that lookups in more than one chart reach: the layout is too tight for a map of this size there. What is covered
  /// stays its chart's; what is not goes to the chart that is nearer.
  std::vector<std::uint32_t> contested;
};

/// f(to, from) for every texel that repeats another.
template <class F>
void forRepeated(const Padding& padding, const F& f) {
  for (std::size_t i = 0; i < padding.from.size(); ++i)
    if (const std::uint32_t from = padding.from[i]; from != kNone && from != i) f(i, from);
}

/// `chart`: of each texel of the maps, which lie one below the other, `side` texels each; kNone = not covered. A texel whose centre is less
/// than 1 texel, along both axes, from some place of a chart repeats the nearest covered texel of that chart, for a bilinear lookup there
/// reads it; others (and those of charts that have no texel near) within kPadding repeat the nearest covered texel of any chart; the lower
/// number where two tie. Nothing goes over the border of a map. Time: linear in texels and triangles.
Padding makePadding(const Scene&, const Charts&, std::span<const std::uint32_t> chart, int side, const Run&);

}  // namespace lmc
