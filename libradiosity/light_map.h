#pragma once
/// A light map being baked: the named state that grows with its texels, and the stages that fill it tile by tile.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

#include "libradiosity/gather.h"
#include "libscene/texel_array.h"

namespace lmc {

/// One entry a texel, rows from the top. Everything sampled is kept in two independent halves: their mean is the value, half their
/// difference a sample of its error.
struct LightMap {
  int width = 0, height = 0;
  TexelArray<std::uint32_t> chart;         ///< kNone = not covered
  TexelArray<std::uint32_t> object;        ///< of the texel's first fragment; 0 where not covered
  std::array<TexelArray<Rgb>, 2> direct;   ///< punctual lights and emitters, E [lx]
  TexelArray<std::uint8_t> edge;           ///< 1 where direct light changes within the texel or beside it
  std::array<TexelArray<Rgb>, 2> bounced;  ///< E by bounces [lx]
  std::array<TexelArray<float>, 2> sky;    ///< share of hemisphere rays that left the level
  TexelArray<Rgb> coarse;                  ///< `bounced`, mean of the halves, from patches of twice the size
  TexelArray<Rgb> variance;                ///< of the mean of sky and bounced light [lx^2]
  TexelArray<std::uint32_t> rays;          ///< hemisphere rays cast, each half; 0 = interpolated
  TexelArray<std::uint8_t> near;           ///< of gathered texels: 1 where many rays meet something near, 2 where something touches
  int rounds = 0;                          ///< of hemisphere rays that went beyond the goal
  std::vector<double> interpolation2;      ///< one an object: expected square of the interpolation error, summed over its texels [lx^2]
  std::size_t size() const { return chart.size(); }
  std::size_t index(const TexelTile& tile, int x, int y) const {
    return std::size_t(tile.y0 + y) * std::size_t(width) + std::size_t(tile.x0 + x);
  }
};

/// Values of a finished map [lx].
struct LightMapValues {
  TexelArray<Rgb> direct;  ///< without a bounce: punctual lights, emitters, sky
  TexelArray<Rgb> indirect;
  TexelArray<Rgb> error;  ///< standard error of their sum, pooled over neighbours of a chart
};

/// What a map's error is made of, relative to its mean illuminance (design.md section 5).
struct ErrorLedger {
  double mean = 0.0;             ///< illuminance, mean over covered texels and channels [lx]
  double noise = 0.0;            ///< RMS standard error of the sampling
  double interpolation = 0.0;    ///< RMS error of the texels between gathered ones
  double field = 0.0;            ///< RMS difference that patch size makes
  double tail = 0.0;             ///< upper bound of the light that stopping early leaves out
  double tailEstimate = 0.0;     ///< best guess of it
  double leftOut = 0.0;          ///< upper bound of the effects that the plan left out
  double seams = 0.0;            ///< RMS distance by which closing seams moved texels: meant, so no part of the estimate and the bound
  double rims = 0.0;             ///< the same of texels partly in solids, which rims.h gave the light before them
  double estimate = 0.0;         ///< best estimate of the relative RMS error
  double bound95 = 0.0;          ///< upper bound at 95 % confidence
  double low = 0.0, high = 0.0;  ///< interval of the true error, 90 %: its upper end is the bound
  double worstObject = 0.0;      ///< largest bound95 over objects, each relative to max(its own mean, 1 % of the level's)
  std::uint32_t worstObjectId = kNone;
  std::uint64_t texels = 0;    ///< covered
  std::uint64_t gathered = 0;  ///< of them, with hemisphere rays of their own
};

struct MapOptions {
  double goal = 0.02;       ///< relative RMS error asked for
  bool interpolate = true;  ///< where light is smooth; else every texel is gathered
  double tail = 0.0;        ///< upper bound of the bounced light that the solution leaves out, as a share of it
  std::uint32_t rays = 0;   ///< hemisphere rays of each half of a gathered texel; 0 = from the goal
  int rounds = 0;           ///< of hemisphere rays beyond the goal's, each towards kRoundStep of the error before
  std::function<bool(double goal, std::uint64_t rays)> goOn{};  ///< asked instead before each such round, with the goal and the rays of it
  double leftOut = 0.0;                                         ///< upper bound of what the plan leaves out, relative to the level's mean
  double sampled = 1.0;                                         ///< share of the map's cells that are wanted: foretellHemisphere
};

/// Charts, objects and coverage of every texel.
LightMap startMap(const Scene&, const TexelMap&, const Run&);

/// Punctual lights and emitters: 16 places a texel; 2 places x goal-dependent more where a shadow's or a cone's edge is in the texel or
/// beside it.
void bakeDirect(LightMap&, const Scene&, const TexelMap&, const DirectLight&, const MapOptions&, const Run&);

/// What direct light gives the texels of an object: sums over them [lx, lx^2].
struct ObjectLight {
  /// Of the largest channel: light, and its square.
  struct Sums {
    double sum = 0.0, sum2 = 0.0;
    void add(double e) {
      sum += e;
      sum2 += e * e;
    }
    Sums& operator+=(const Sums& o) {
      sum += o.sum;
      sum2 += o.sum2;
      return *this;
    }
  };
  double texels = 0.0;
  double light = 0.0;   ///< as it is, mean over channels
  Sums punctual, area;  ///< of lamps, of emitters, if nothing blocked them
  Sums hidden;          ///< what shadows take away
  ObjectLight& operator+=(const ObjectLight& o) {
    texels += o.texels;
    light += o.light;
    punctual += o.punctual;
    area += o.area;
    hidden += o.hidden;
    return *this;
  }
};

/// What two places on every texel tell of the lights.
struct DirectPilot {
  /// Of one lamp: texels that it would light if nothing blocked it, sums of what it would give them [lx, lx^2].
  struct Given {
    double texels = 0.0, sum = 0.0, sum2 = 0.0;
    void add(double most) {
      texels += most > 0.0;
      sum += most;
      sum2 += most * most;
    }
  };
  std::vector<Given> lights;         ///< one a punctual light; what groups stand for is not in it
  std::vector<ObjectLight> objects;  ///< one an object
  double rays = 0.0;                 ///< that bakeDirect is going to cast, about
  double ray_s = 0.0;                ///< what one of them takes, all that goes with it included [CPU s]
  DirectPilot& operator+=(const DirectPilot&);
};

/// One place of each half on every texel: fills `direct` and `edge` of the map.
DirectPilot pilotDirect(LightMap&, const Scene&, const TexelMap&, const DirectLight&, const MapOptions&, const Run&);

/// Hemisphere rays in rounds: a pilot at the corners of cells (map_cells.h), which are halved where light is not straight between them;
/// then as many rays as the goal asks for, given out so that the fewest reach it, then at most two corrections of both. Counts are fixed
/// between rounds from sums in a fixed order.
void bakeHemisphere(LightMap&, const Scene&, const TexelMap&, const Tracer&, const Gather&, const MapOptions&, const Run&);

/// Hemisphere rays that bakeHemisphere is going to cast on the whole map.
struct HemisphereForecast {
  double rays = 0.0, standardError = 0.0;
  double near = 0.0;                  ///< of them, those that meet something near
  double cast = 0.0, nearCast = 0.0;  ///< on the sample, and of them
  double cast_s = 0.0;                ///< what these and the rays of near hits took [CPU s]
  /// Of the light that comes from what is near: mean over texels of the largest channel, and of its square [lx, lx^2].
  struct NearLight {
    double texels = 0.0, mean = 0.0, mean2 = 0.0;
  };
  std::vector<NearLight> nearLight;  ///< one an object, then the level; no texels: not in the sample
};
/// bakeHemisphere on MapOptions::sampled of the map, whose other texels lose their charts. `onCells` is called when cells are there, which
/// are made for the whole map.
HemisphereForecast foretellHemisphere(LightMap&, const Scene&, const TexelMap&, const Tracer&, const Gather&, const MapOptions&,
                                      const std::function<void()>& onCells, const Run&);

inline constexpr double kRoundStep = 0.98;  ///< rays go with error^-1.43: a round casts 3 % of what was cast before
inline constexpr int kMostRounds = 200;

LightMapValues values(const LightMap&, const Scene&);

/// What the ledger says of each texel: noise, patches and interpolation in squares, root mean square of the channels [lx]; 0 where nothing
/// is covered.
TexelArray<float> statedErrors(const LightMap&, const Scene&);

/// What is not in the map, told by others.
struct Omitted {
  double tail = 0.0, tailEstimate = 0.0;  ///< of the solution, as shares of the bounced light
  double leftOut = 0.0;                   ///< ErrorLedger::leftOut
  double leftOutObject = 0.0;             ///< the same of any object, against max(its own mean, kDimRoom of the level's)
};
ErrorLedger ledger(const LightMap&, const Scene&, const Omitted&);

/// The error that patches of a size leave, against the change of the map when light is read from patches of twice the size: 1/3 at second
/// order, 1 at first, 0.6 to 1.3 as measured (docs/stages.md); and how far the bound goes above it.
inline constexpr double kFieldShare = 0.75, kFieldBound = 1.5;

/// Lower ends of what patches and interpolation may be, against their estimates: second order, and bends that end where cells do.
inline constexpr double kFieldLow = 0.45, kInterpolationLow = 0.5;

/// An object's error counts against max(its own mean, this share of the level's), and may be kObjectLimit times the goal (design.md
/// section 5).
inline constexpr double kDimRoom = 0.01, kObjectLimit = 3.0;

/// Upper bound at 95 % confidence of a noise that was estimated from so many texels, as a factor: 1.645 of the relative spread sqrt(2/n) of
/// a sum of variances with n degrees of freedom. Neighbours share the strongest of what they see: eight texels to a degree.
inline double noise95(double texels) { return std::sqrt(1.0 + 1.645 * std::sqrt(2.0 / std::max(1.0, texels / 8.0))); }
inline double noise5(double texels) { return std::sqrt(std::max(0.0, 1.0 - 1.645 * std::sqrt(2.0 / std::max(1.0, texels / 8.0)))); }

}  // namespace lmc
