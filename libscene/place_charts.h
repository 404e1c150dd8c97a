#pragma once
/// Charts of a level placed in square maps: how large they are drawn, which map each goes to, and where it lies there.
#include <optional>
#include <string>
#include <vector>

#include "libscene/flatten.h"
#include "libscene/pack.h"
#include "libscene/run.h"

namespace lmc {

/// A chart that wants a place.
struct ChartUse {
  const FlatChart* chart = nullptr;
  double texels = 1.0;      ///< a unit of its plane, wanted
  bool mirrored = false;    ///< its faces run the other way about
  std::uint32_t group = 0;  ///< charts of a group share a map
};

struct PlaceOptions {
  int side = 0;  ///< of the maps; 0 = as small as will do, in steps of 4
  /// Sizes are no more than wishes: with a side, all charts grow or shrink by one factor to fill one map; where more than maxMaps would be
  /// needed they shrink.
  bool fill = false;
  int mostSide = 4096;  ///< where side is 0: more maps rather than larger ones
  int padding = 2;      ///< texels between charts
  int maxMaps = 16;
  const TexelMask* taken = nullptr;  ///< texels of the first map that are not free
};

struct ChartPlaces {
  int side = 0, maps = 1;
  double factor = 1.0;                     ///< on all charts' texels
  std::vector<std::uint32_t> map;          ///< one a use
  std::vector<std::vector<glm::vec2>> uv;  ///< one a use, one a vertex of its chart: multiples of 2^-23 in [0, 1]
  std::vector<std::uint32_t> smaller;      ///< groups that fit no map at their size and are drawn smaller
  /// Faces of charts that lost their side or lie on others because places were rounded: (use, index in FlatChart::faces).
  std::vector<std::pair<std::uint32_t, std::uint32_t>> spoilt;
};

/// Turns a chart so that its long straight borders lie along the axes or, where it has none, so that its box is small; moves it to the
/// origin.
void alignChart(FlatChart&);

/// Parts of an aligned chart that leaves most of its box empty, or is longer than `longest`
/// where it has faces enough, cut across its longer side as often as that helps
/// packing; aligned. Boxes below `leastBox` are left alone. What lies flat once lies flat in parts.
std::vector<FlatChart> cutSprawling(FlatChart, double longest, double leastBox);

/// Nothing where more than maxMaps would be needed.
std::optional<ChartPlaces> placeCharts(const std::vector<ChartUse>&, const PlaceOptions&, const Run&);

}  // namespace lmc
