#pragma once
/// Light that reaches a place without a bounce, from punctual lights and emissive triangles. (The sky comes with the hemisphere rays:
/// gather.h.)
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "libradiosity/emitters.h"
#include "libscene/rng.h"
#include "libscene/texels.h"
#include "libscene/tracer.h"

namespace lmc {

/// Mean over a set of places and which lights had a say.
struct DirectSample {
  glm::dvec3 illuminance{0.0};  ///< E [lx], mean over the places
  std::uint64_t signature = 0;  ///< equal for two sets where the same lights are seen and the same are hidden
  bool mixed = false;           ///< a light is seen from some of the places and hidden from others, or shines on some only
};

class DirectLight {
 public:
  /// Without `shadows` light goes through everything and no ray is cast.
  DirectLight(const Scene&, const Tracer&, bool shadows);
  bool any() const { return !scene_.lights.empty() || hasEmitters(); }
  bool hasEmitters() const { return !emitters_.whole.empty(); }
  const Emitters& emitters() const { return emitters_; }
  std::uint64_t raysOf(std::uint32_t light) const { return rays_[light].load(); }

  /// Lights that may reach some point of the sphere.
  std::vector<std::uint32_t> lightsFor(const glm::dvec3& centre_m, double radius_m) const;

  /// One place each for every point; `address` names the random numbers on the emitters. Punctual lights: one shadow ray a place and light.
  /// Emitters: one ray a place, to a piece chosen by about what it would give, a place on it by area; the visible share is weighted by
  /// the kernel (sum K V / sum K, channel by channel), so that it is exact where nothing blocks; the bias of the ratio falls with the
  /// number of rays.
  DirectSample sample(std::span<const SurfacePoint> places, std::span<const std::uint32_t> lights, const Sobol4& address) const;

 private:
  void addPunctual(DirectSample&, std::span<const SurfacePoint>, std::uint32_t light) const;
  void trace(std::span<const Ray>, std::span<std::uint8_t> blocked, Purpose) const;
  void addEmitters(DirectSample&, std::span<const SurfacePoint>, const Sobol4&) const;

  const Scene& scene_;
  const Tracer& tracer_;
  bool shadows_;
  Emitters emitters_;
  mutable std::vector<std::atomic<std::uint64_t>> rays_;  // shadow rays of each punctual light
};

}  // namespace lmc
