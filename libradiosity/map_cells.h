#pragma once
/// Where a map is gathered and where it is interpolated. Light that comes by the hemisphere is smooth over most of a wall: rectangles of
/// texels of one chart are gathered at their corners alone and halved, along x or along y, until what lies between is straight enough.
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "libscene/run.h"
#include "libscene/texel_array.h"
#include "libscene/texels.h"
#include "libscene/tracer.h"

namespace lmc {

/// Coverage of a map, row by row.
struct MapLayout {
  int width = 0, height = 0;
  const std::uint32_t* chart = nullptr;  ///< one a texel; kNone = not covered
};

class MapCells {
 public:
  /// A rectangle with its corner texels, both inclusive; of one chart, covered throughout, its surface bending by little between texels.
  struct Cell {
    std::int32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;
    std::uint32_t child = kNone;  ///< the first of two; kNone = a leaf
    bool alongY = false;          ///< the children lie one above the other
  };
  struct Value {
    glm::dvec3 illuminance{0.0};  ///< by the hemisphere [lx]
    double variance = 0.0;        ///< of it, mean over channels [lx^2]
  };
  using ValueAt = std::function<Value(std::size_t texel)>;
  struct Tolerance {
    double error = 0.0;         ///< between gathered texels [lx]
    double significance = 3.0;  ///< how often the noise's own part a bend must be, to be one
    double steep = 0.35;        ///< change from end to end, of the larger one, from which one halving that looks straight does not do
  };
  using ToleranceAt = std::function<Tolerance(std::size_t texel)>;

  /// Cells of at most kWidest texels, cut where charts end and bend, and where something stands on the surface between their corners.
  /// Without `interpolate` every texel is a cell of its own.
  MapCells(const MapLayout&, const Scene&, const TexelMap&, const Tracer&, bool interpolate, const Run&);

  bool gathered(std::size_t texel) const { return gathered_[texel] != 0; }

  /// Halves leaves where the light at a point in the middle differs from what its ends foretell by more than noise explains, and by more
  /// than the tolerance allows. New corners become gathered; their number comes back.
  std::size_t refine(const ValueAt&, const ToleranceAt&);

  /// f(texel, corners, weights) for every texel that is not gathered: its value is sum of weights * values of the corners.
  using Corners = std::array<std::size_t, 4>;
  using Weights = std::array<double, 4>;
  void forInterpolated(const std::function<void(std::size_t, const Corners&, const Weights&)>&) const;

  /// Expected square of the interpolation error [lx^2], summed over the texels that each leaf stands for, from the last halving and from
  /// the one before: f(texel of a corner, sum, sum). Noise is taken out of the sums, so that one of them may be negative.
  void forErrors(const ValueAt&, const std::function<void(std::size_t, double, double)>&) const;

  static constexpr int kWidest = 16;  ///< texels of a cell before its first halving

  /// Cells that lie together, before any is refined: what a sample is drawn of.
  struct Block {
    std::size_t id = 0;
    double cells = 0.0, texels = 0.0, points = 0.0;  ///< gathered points; those that blocks share are shared out
    std::vector<std::size_t> probes;                 ///< some of its gathered texels
  };
  std::vector<Block> blocks(std::size_t probes);
  /// For a forecast: keeps about `wanted` of the blocks, each with a chance that goes with its entry in `sizes`; where the rest was, `chart`
  /// becomes kNone. Blocks that differ in their cells are drawn evenly.
  void sample(std::span<const Block>, std::span<const double> sizes, double wanted, std::span<std::uint32_t> chart);
  /// What a texel of a sample stands for: 1 / its chance, for each of the map's cells that hold it and are in the sample, over all that hold
  /// it. 1 without a sample.
  double standsFor(std::size_t texel) const { return standsFor_.empty() ? 1.0 : double(standsFor_[texel]); }
  /// Sum over the whole map of what is known of the sample's gathered texels.
  struct Estimate {
    double sum = 0.0, standardError = 0.0;
    double blocks = 0.0;  ///< in the sample
  };
  Estimate estimate(const std::function<double(std::size_t texel)>&) const;

 private:
  // What the light did when a cell's extent along an axis was halved: mean square of middle minus mean of the ends, and the part of it that
  // noise explains. A step can look straight at one halving, hardly at two: the one before counts as well.
  struct Halving {
    double square = 0.0, noise = 0.0;
    bool known = false;
    double sure() const { return square - noise; }
  };
  struct Bend {
    Halving last, before;
  };
  std::size_t blockOf(const Cell&) const;
  void add(const Cell&);
  void halve(std::uint32_t, bool alongY);
  bool whole(const Cell&, std::span<const std::uint8_t> joined) const;
  Halving halvingOf(const Cell&, const ValueAt&) const;
  template <class F>
  void forTexels(const Cell&, F&&) const;
  template <class F>
  void forLeaves(const ValueAt&, F&&) const;
  std::size_t index(int x, int y) const { return std::size_t(y) * std::size_t(map_.width) + std::size_t(x); }

  MapLayout map_;
  std::vector<Cell> cells_;
  std::uint32_t roots_ = 0;
  TexelArray<std::uint8_t> gathered_;
  TexelArray<std::uint8_t> held_;    // by how many roots of the whole map; for samples
  std::vector<double> weights_;      // of a sample's roots
  TexelArray<float> standsFor_;
};

}  // namespace lmc
