#pragma once
/// Seams: edges of charts that meet on the surface. Bilinear lookups along both sides are made equal, as far as the standard errors of the
/// texels allow, where the surface is smooth; creases stay as they are.
#include <array>
#include <cstdint>
#include <vector>

#include "libradiosity/light_map.h"
#include "libradiosity/patch_mesh.h"
#include "libscene/padding.h"

namespace lmc {

struct Seams {
  std::vector<SharedEdge> smooth;  ///< to be closed
  std::uint64_t creases = 0;       ///< edges of charts at which the surface bends: none of them is touched
};

/// Edges at which two triangles with a place in the light map meet on the surface, but at two places of the map; of one chart, two charts
/// or two objects. Smooth are those where the normals of both sides agree within kSeamNormal_rad at both ends and the faces bend by less
/// than kSeamBend_rad.
Seams findSeams(const Scene&);
inline constexpr double kSeamNormal_rad = 0.052;  ///< 3 degrees: light at 45 degrees changes by 5 %; 8-bit normals are off by 0.5
inline constexpr double kSeamBend_rad = 1.048;    ///< 60 degrees, a hair more: a round column of six sides

/// Texels in which the middle of a stretch of a seam lies, and the difference across it, largest channel, against the light there.
struct SeamSample {
  std::array<std::uint32_t, 2> texel;
  float before, after;
};

/// Differences of bilinear lookups across seams at places half a texel of the finer side apart.
struct SeamJump {
  double rms = 0.0, largest = 0.0;                  ///< over places and channels [lx]
  double relativeRms = 0.0, relativeLargest = 0.0;  ///< against the mean of both sides' channels, or 1 % of the level's
};

struct SeamResult {
  SeamJump before, after;
  std::vector<SeamSample> samples;
  std::uint64_t texels = 0;                        ///< covered ones that lookups at seams read and that may move
  std::uint64_t padding = 0;                       ///< the same of padding, which is moved as well and in no count below
  std::uint64_t moved = 0;                         ///< by more than a thousandth
  std::uint64_t limited = 0;                       ///< that went to their limit
  double largestMove_lx = 0.0, largestMove = 0.0;  ///< of a channel; the second against its value
  double rmsMove = 0.0;                            ///< over all covered texels and channels of the level, against their mean
};

/// Fills the padding of all values, and closes the smooth seams. Minimises, for each channel,
///   sum over texels ((x - E)/s)^2 + sum over places l (kSeamPull (left - right)/s_place)^2,  |x - E| <= min(kSeamErrors e + kSeamBounds b,
///   E/2)
/// with e the standard error of a texel, b = half its largest difference from a neighbour of its chart + goal/4 E (a place half a texel off
/// in the same square may be off by that), s = e + b, s_place the sum of weight s over both footprints, l the texels that a place stands
/// for. Unknowns are all texels in the footprints, padding too, which stays by its own texel's value with 3 b for b, being up to a texel
/// and a half from it. Of other charts' texels none is moved. Direct and indirect light keep their ratio.
SeamResult closeSeams(LightMapValues&, const LightMap&, const Scene&, const Charts&, const Padding&, const Seams&, double goal, const Run&);
inline constexpr double kSeamErrors = 3.0, kSeamBounds = 2.0, kSeamPull = 40.0;

/// Every texel outside the charts gets the values of the one that it repeats.
void fillPadding(LightMapValues&, const Padding&);

}  // namespace lmc
