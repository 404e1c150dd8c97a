#pragma once
/// Unbiased illuminance of texels by path tracing over the Tracer alone: no patches, no cache, nothing interpolated. It checks what a bake
/// states (audit.h) and makes references.
///
/// E = punctual lights and emitters seen from places all over the texel's covered square (next-event estimation)
///   + pi/N sum of what cosine-distributed rays bring: sky, emitters, or rho times the same again at the surface they meet.
/// Emitters are found in both ways, weighted by the balance heuristic [veach1995]. A path ends by Russian roulette with the albedo it
/// meets, so that what it carries never grows and no bounce is left out.
#include <cstdint>
#include <vector>

#include "libscene/scene.h"
#include "libscene/texels.h"
#include "libscene/tracer.h"

namespace lmc {

struct PathOptions {
  bool shadows = true;  ///< else punctual lights and emitters shine through everything, as a plan without the effect has it
  int bounces = -1;     ///< at most; -1 = until roulette ends the path
};

class PathTracer {
 public:
  PathTracer(const Scene&, const Tracer&, const PathOptions& = {});

  /// Paths [begin, end) of the stream `key`: the sum of what each says of E [lx]. Path k is the same whatever else is asked; its first
  /// direction and its places on the texel are points k of scrambled Sobol sequences, so that sums over a power of two are the even ones.
  glm::dvec3 sum(const TexelSampler&, std::uint64_t key, std::uint32_t begin, std::uint32_t end) const;

 private:
  struct Shining {
    std::uint32_t triangle;
    double area_m2, chance;  // of being asked
    bool back;               // shines from its back as well
    bool blocks;             // so that rays can meet it
  };
  struct Batch;
  void direct(Batch&, bool first) const;
  void addPunctual(Batch&, bool first) const;
  void addEmitters(Batch&) const;
  void bounce(Batch&, int bounces) const;
  double densityOf(std::uint32_t triangle) const;
  Ray towards(const SurfacePoint&, const glm::dvec3& way_m, bool endless) const;

  const Scene& scene_;
  const Tracer& tracer_;
  PathOptions options_;
  std::vector<Shining> emitters_;
  std::vector<double> upTo_;              // of the emitters' chances
  std::vector<std::uint32_t> emitterOf_;  // one a triangle; kNone = dark. Empty where there are none
};

}  // namespace lmc
