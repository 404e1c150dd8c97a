#pragma once
/// Ambient occlusion: how much of the hemisphere above a place is open, and which way the open part lies.
///
/// Openness, 1 = nothing in the way, 0 = all of it covered, in two weightings: `cosine` = 1/pi times the integral of V cos over the
/// hemisphere about the shading normal, `uniform` = 1/(2 pi) times the integral of V, the share of rays that hit nothing. V = 0 below the
/// face itself, whatever its shading normal says. Back faces block, holes of masked materials do not.
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "libscene/run.h"
#include "libscene/texel_array.h"
#include "libscene/texels.h"
#include "libscene/tracer.h"

namespace lmc::ao {

/// How much an occluder at distance t counts.
enum class FallOff {
  None,      ///< 1 up to the distance
  Linear,    ///< 1 - t/distance
  Quadratic  ///< (1 - t/distance)^2
};

struct Options {
  double error = 0.01;                                          ///< RMS over all texels (or vertices), of either weighting
  double distance_m = std::numeric_limits<double>::infinity();  ///< farther occluders do not count
  FallOff fallOff = FallOff::None;                              ///< needs a finite distance, unless None
  bool bent = false;                                            ///< bent normals are wanted
  std::uint32_t rays = 0;                                       ///< each texel; 0 = as many as the error asks for
};

/// One entry a texel (rows from the top) or a vertex.
struct Openness {
  TexelArray<float> cosine, uniform;  ///< [0, 1]; 0 where there is nothing to ask for
  TexelArray<float> error;            ///< standard error, the larger of both weightings', pooled over neighbours
  /// 1 where a texel's middle lies inside a solid that stands on its surface, beside texels that see something: there openness is 0. Maps
  /// only.
  TexelArray<std::uint8_t> buried;
  TexelArray<glm::vec3> bent;  ///< unit, world: mean of the open directions, weighted by the cosine; the shading normal where none is
                               ///< open; empty unless asked for
  double rmsError = 0.0;       ///< the larger of both weightings', over all entries asked for
  double darkShare = 0.0;      ///< of the entries asked for, those whose cosine openness is below 0.01
  std::uint64_t asked = 0, rays = 0;  ///< entries; rays cast
};

/// Every covered texel: the mean over its part of its chart, places inside solids left out unless all are. In rounds (a pilot, then what
/// the error asks for, given out so that the fewest rays reach it, then at most two corrections); counts are fixed between rounds.
/// `chart`: of each texel, kNone = not covered.
Openness bakeMap(const Scene&, const TexelMap&, std::span<const std::uint32_t> chart, const Tracer&, const Options&, const Run&);

/// What bakeMap is going to cast over these texels, and what was cast to tell it.
struct MapForecast {
  double rays = 0.0;
  double cast = 0.0, cast_s = 0.0;  ///< rays of the pilot and their CPU seconds, those of the texels' places included
};
/// From a pilot of 32 rays a texel; where Options::rays says how many, from all of them.
MapForecast foretellMap(const Scene&, const TexelMap&, std::span<const std::uint32_t> chart, const Tracer&, const Options&, const Run&);

/// Cosine openness as a picture shows it: buried texels have that of the texels beside them, so that no dark rim runs along the foot of a
/// wall. One entry a texel.
TexelArray<float> withoutRims(const Openness&, std::span<const std::uint32_t> chart, int width);

/// Every vertex of a triangle: the mean over the triangles round it, weighted with its share of the barycentric weights. Vertices of equal
/// position and normal are one, so that UV seams do not show.
Openness bakeVertices(const Scene&, const Tracer&, const Options&, const Run&);

/// One place, by `rays` rays: cosine and uniform. `scramble` numbers independent estimates.
struct AtPlace {
  double cosine, uniform;
};
AtPlace opennessAt(const SurfacePoint&, const Tracer&, const Options&, std::uint32_t rays, std::uint64_t seed, std::uint32_t scramble);

}  // namespace lmc::ao
