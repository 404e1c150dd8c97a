#pragma once
/// Light that reaches a place without a bounce, from punctual lights and emissive triangles. (The sky comes with the hemisphere rays:
/// gather.h.)
#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "libradiosity/light_tree.h"
#include "libscene/rng.h"
#include "libscene/texels.h"
#include "libscene/tracer.h"

namespace lmc {

/// What lights give a set of places, mean over them.
struct DirectPart {
  glm::dvec3 illuminance{0.0};  ///< E [lx]
  glm::dvec3 unshadowed{0.0};   ///< E if nothing were in the way [lx]
  bool seen = false;            ///< from some of the places
  bool mixed = false;           ///< seen from some of the places and hidden from others, or shining on some only
  DirectPart& operator+=(const DirectPart& o) {
    illuminance += o.illuminance;
    unshadowed += o.unshadowed;
    seen |= o.seen;
    mixed |= o.mixed;
    return *this;
  }
};

/// A triangle that a texel covers part of: what lies in the texel.
struct TexelPiece {
  std::uint32_t triangle = kNone;
  std::array<glm::dvec2, 3> bary;  ///< weights of the triangle's second and third corner, at the piece's corners
  double share = 0.0;              ///< of what the texel covers
};

class DirectLight {
 public:
  /// Without `shadows` light goes through everything and no ray is cast.
  DirectLight(const Scene&, const Tracer&, bool shadows);
  bool any() const { return !scene_.lights.empty() || hasEmitters(); }
  bool hasEmitters() const { return !emitters_.whole.empty(); }
  const Emitters& emitters() const { return emitters_; }
  const Tracer& tracer() const { return tracer_; }
  std::uint64_t raysOf(std::uint32_t light) const { return rays_[light].load(); }

  /// While it lives, shadow rays of this thread are counted light by light.
  class Tally {
   public:
    explicit Tally(const DirectLight&);
    ~Tally();
    Tally(const Tally&) = delete;
    Tally& operator=(const Tally&) = delete;
    std::vector<std::uint64_t> rays;  ///< one a punctual light
  };
  /// Rays of a Tally whose results came from a journal.
  void countAsCast(std::span<const std::uint64_t> rays) const;

  /// What the places of a sphere must ask; with a normal, fewer. A single place (radius 0) gets a coarser cut.
  LightCut lightsFor(const glm::dvec3& centre_m, double radius_m) const {
    return tree_.cutFor({centre_m, radius_m}, radius_m > 0.0 ? LightTree::kMostNodes : LightTree::kFewNodes);
  }
  LightCut lightsFor(const Receivers& receivers) const { return tree_.cutFor(receivers); }

  /// One punctual light: one shadow ray a place.
  DirectPart punctual(std::span<const SurfacePoint> places, std::uint32_t light) const;
  /// The same for a texel that is long against its distance from the light, mean over the pieces by their shares: places go by the solid
  /// angle under which the light sees them, so that the pole of 1/d^2 cancels and no texel gets more than the light sends its way.
  DirectPart punctualNearby(std::span<const TexelPiece> pieces, std::uint32_t light, std::uint32_t places, const Sobol4& address) const;
  /// Whether that is called for, at a texel of this diameter that holds the place.
  bool isNearby(std::uint32_t light, const glm::dvec3& place_m, double diameter_m) const;
  /// Emitters: one ray a place, to a piece chosen by about what it would give, a place on it by area; `address` names the random numbers.
  /// The visible share is weighted by the kernel (sum K V / sum K, channel by channel), so that it is exact where nothing blocks; the bias
  /// of the ratio falls with the number of rays.
  DirectPart emitters(std::span<const SurfacePoint> places, std::span<const std::uint32_t> emitters, const Sobol4& address) const;
  /// The groups of a cut: `draws` rays in turn from the places, each to one of their lights: to a place on an emitter by area, or by solid
  /// angle where that is large, so that no draw counts more than about Groups::mostWeight().
  DirectPart groups(std::span<const SurfacePoint> places, const LightTree::Groups&, std::size_t draws, const Sobol4& address) const;
  /// `where`: all places that will be asked for, which may be fewer than the cut serves.
  LightTree::Groups groupsAt(const LightCut& cut, const Receivers& where) const { return {tree_, cut, where}; }
  /// All of a cut.
  DirectPart sample(std::span<const SurfacePoint> places, const LightCut&, const Sobol4& address) const;

 private:
  void countRays(std::uint32_t light, std::uint64_t rays) const;
  void trace(std::span<const Ray>, std::span<std::uint8_t> blocked, Purpose) const;
  Ray towards(const Light&, const SurfacePoint&, const glm::dvec3& towards, bool endless) const;

  const Scene& scene_;
  const Tracer& tracer_;
  bool shadows_;
  Emitters emitters_;
  LightTree tree_;
  mutable std::vector<std::atomic<std::uint64_t>> rays_;  // shadow rays of each punctual light
};

}  // namespace lmc
