#pragma once
/// A surface cut into charts that lie flat without folds and with little stretch.
#include "libscene/flatten.h"
#include "libscene/run.h"

namespace lmc {

inline constexpr double kMaxChartStretch = 1.05;  ///< L2 [sander2001] of a made chart

/// Cuts the faces (in order) at creases first, then in two wherever a part cannot be laid flat: parts of like normal, as variational shape
/// approximation [cohen2004] with two proxies finds them. Ends with single triangles for hopeless input. The same charts for any number of
/// threads.
std::vector<FlatChart> cutCharts(const Surface&, std::vector<std::uint32_t> faces, const Run&);

/// The charts that an object's map UVs make already.
struct KnownCharts {
  std::vector<FlatChart> charts;     ///< those without folds and with a stretch of at most `maxStretch`; mirrored ones are turned over
  std::vector<std::uint32_t> other;  ///< the other faces, in order
};
KnownCharts knownCharts(const Scene&, const Object&, const Surface&, double maxStretch);

}  // namespace lmc
