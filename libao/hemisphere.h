#pragma once
/// Rays over the hemispheres of one texel's places, and what they found.
#include <functional>
#include <optional>
#include <span>

#include "libao/ao.h"
#include "libao/directions.h"
#include "libscene/burial.h"

namespace lmc::ao {

/// Weights of all rays and of those that were blocked, in two independent halves.
struct Sums {
  struct Half {
    float cosine = 0.0f, uniform = 0.0f, blockedCosine = 0.0f, blockedUniform = 0.0f;
  };
  std::array<Half, 2> halves;
  std::uint32_t rays = 0;  ///< each half, below faces included
  /// How the texel's middle lies. Where it is closed, what other places see of the open they see from beyond a surface. Asked only where
  /// some of its places see nothing.
  Lie middle = Lie::Unknown;

  // Blocked sums are made of the same terms in the same order: all blocked is exactly 0, none exactly 1. A half whose every place lay
  // inside a solid knows nothing, and the other speaks for it.
  double cosine(std::size_t h) const {
    const Half& own = halves[h].cosine > 0.0f ? halves[h] : halves[1 - h];
    return own.cosine > 0.0f ? 1.0 - double(own.blockedCosine) / double(own.cosine) : 0.0;
  }
  double uniform(std::size_t h) const {
    const Half& own = halves[h].uniform > 0.0f ? halves[h] : halves[1 - h];
    return own.uniform > 0.0f ? 1.0 - double(own.blockedUniform) / double(own.uniform) : 0.0;
  }
  double cosine() const { return 0.5 * (cosine(0) + cosine(1)); }
  double uniform() const { return 0.5 * (uniform(0) + uniform(1)); }
};

/// Where the rays of a texel or vertex start.
struct Places {
  std::function<SurfacePoint(glm::vec2)> at;  ///< for a point of the unit square
  /// A texel's middle. Where it is free, places of the texel inside a solid (a wall that stands on an uncut floor) do not count; where it
  /// is inside, so is the texel, and its openness 0. In a closed room, places that lie beyond its walls (of a column that goes on below
  /// the floor) do not count. None = every place counts.
  std::optional<SurfacePoint> middle{};
};

class Hemisphere {
 public:
  Hemisphere(const Tracer&, const Options&);

  /// Rays until each half has `until` (a multiple of kBlock); ray k of a half is the same whatever was asked before. `bent`, when not
  /// null, takes the open directions. Returns the rays cast.
  std::uint32_t cast(std::uint64_t address, std::uint32_t until, const Places&, Sums&, glm::vec3* bent) const;

  /// How a place lies. Adds the rays that it costs.
  Lie lie(const SurfacePoint&, std::uint64_t address, std::uint32_t& cast) const;

  /// The rays until each half has `until`, as cast() traces them: those with tFar below 0 are not.
  std::vector<RayFan> fans(std::uint64_t address, std::uint32_t until, const Places&) const;

 private:
  struct Block;
  struct Batch;
  struct Turn;
  class Judge;
  std::uint32_t castFrom(std::uint64_t address, std::uint32_t from, std::uint32_t until, const Places&, Sums&, glm::vec3* bent) const;
  void start(Batch&, const SurfacePoint&, Turn&, std::uint32_t block) const;
  std::uint32_t trace(Batch&) const;
  /// What places see, those of a batch and those before: all something, or too little to tell; or some nothing, which may be chance where
  /// the others see little, and is hardly chance where they see much.
  enum class Sight { Alike, Mixed, Parted };
  static Sight sightOf(const Batch&, const Sums& before);
  float tFar() const { return float(options_.distance_m); }
  float shareOf(const Block&, std::size_t i) const;
  Sums::Half blockedOf(const Block&) const;
  Lie lie(const RayFan&, std::uint32_t& cast) const;
  bool cutOff(const SurfacePoint& from, const Block&, const RayFan&, double side, std::uint32_t& cast) const;
  std::uint32_t finish(Batch&, const Places&, std::uint64_t address, Sums&, glm::vec3* bent) const;

  const Tracer& tracer_;
  const Options& options_;
};

/// What sums of open directions begin with, along the normal: it decides where nothing is open.
inline constexpr float kNextToNothing = 1e-6f;
/// Directions of any length become unit ones; zero stays.
void unitAll(std::span<glm::vec3>);

/// The address of a texel's or vertex's random numbers.
std::uint64_t addressOf(std::uint64_t seed, std::uint32_t x, std::uint32_t y);

}  // namespace lmc::ao
