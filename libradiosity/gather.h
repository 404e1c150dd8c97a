#pragma once
/// Hemisphere rays of a texel: what they bring back from the patch solution, and how many see the sky. Patches are too coarse for hits that
/// are nearer than their size (inside corners, where things touch): there light is evaluated at the hit itself, direct by shadow rays and
/// the rest by one more hemisphere ray (second-level gather).
#include <cstdint>

#include "libradiosity/field.h"
#include "libradiosity/guide.h"

namespace lmc {

/// Sums over the rays of one half of a texel.
struct Gathered {
  glm::dvec3 bounced{0.0};    ///< sum of exitance met: E = sum / rays
  glm::dvec3 coarse{0.0};     ///< the same from patches of twice the size
  glm::dvec3 nearLight{0.0};  ///< what near hits give where they are read from the field as all others
  double sky = 0.0;           ///< rays that left the level, by weight: E_sky = pi L sky / rays
  std::uint32_t near = 0, touching = 0;  ///< rays that met something nearer than the patch's size, than a tenth of it
  Gathered& operator+=(const Gathered& o) {
    bounced += o.bounced;
    coarse += o.coarse;
    nearLight += o.nearLight;
    sky += o.sky;
    near += o.near;
    touching += o.touching;
    return *this;
  }
};

class Gather {
 public:
  /// `field` may be null: then rays only ask for the sky, and cost what an occlusion ray costs. Without `nearHits` no light comes that is
  /// not in the field (bounces are counted). Hits are near that lie within so many sizes of the patch that was hit.
  Gather(const Scene& scene, const Tracer& tracer, const DirectLight& direct, const Field* field, bool nearHits, std::uint64_t seed,
         float nearSizes = 1.0f)
      : scene_(scene), tracer_(tracer), direct_(direct), field_(field), nearHits_(nearHits), nearSizes_(nearSizes), seed_(seed) {}

  /// Rays [begin, end) of the texel's sequence: ray k is the same whatever else is asked. E about the interpolated normal; a direction
  /// below the face itself counts as blocked and is not cast. `guide` tells the rays where to go as it was built last, and takes in what
  /// they find.
  Gathered rays(const TexelTile&, int x, int y, int half, std::uint32_t begin, std::uint32_t end, Guide& guide) const;

  const DirectLight& direct() const { return direct_; }

 private:
  struct NearHit {
    Hit hit;
    std::uint32_t index;  ///< of its ray in the texel's sequence
    float weight;
  };
  void addNear(Gathered&, std::span<const NearHit>, std::uint64_t key, int half) const;

  const Scene& scene_;
  const Tracer& tracer_;
  const DirectLight& direct_;
  const Field* field_;
  bool nearHits_;
  float nearSizes_;
  std::uint64_t seed_;
};

}  // namespace lmc
