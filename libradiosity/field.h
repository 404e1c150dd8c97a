#pragma once
/// The light on patches, and what a ray that hits one of them brings back.
#include <array>
#include <memory>
#include <vector>

#include "libradiosity/direct.h"
#include "libradiosity/patch_mesh.h"
#include "libscene/texel_array.h"

namespace lmc {

/// Direct light of the map's texels, for hits that deserve better than a patch's mean. A view: the map state owns it.
struct DirectMap {
  int width = 0, height = 0;
  const Rgb* illuminance = nullptr;      ///< one a texel [lx]; nullptr = none
  const std::uint32_t* chart = nullptr;  ///< one a texel; kNone = not covered
  const Charts* charts = nullptr;        ///< whose texel it must be
  explicit operator bool() const { return illuminance != nullptr; }
  const std::uint8_t* edge = nullptr;  ///< one a texel; not 0 where light changes within the texel, so that its mean is no value at a place
  /// The number of the texel under a place, or kNone where the object has no place in the map.
  std::uint32_t texelAt(const Scene&, std::uint32_t triangle, glm::vec2 bary) const;
  const Rgb* at(const Scene& scene, std::uint32_t triangle, glm::vec2 bary) const {
    const std::uint32_t i = texelAt(scene, triangle, bary);
    return i == kNone ? nullptr : illuminance + i;
  }
};

/// Finds the parts of patches that lie inside solids (a floor under a column, the end of a beam in a wall): nobody sees them, no light
/// reaches them, and as parts of a mean they would darken what is seen. A place is buried when all of a few rays from it meet backs of
/// one-sided surfaces. Sets Patch::exposed and takes the buried share off Patch::area_m2.
void exposePatches(PatchMesh&, const Scene&, const Tracer&, const Run&);

/// Illuminance on the exposed part of patches before any bounce [lx].
struct PatchLight {
  std::vector<Rgb> direct;  ///< punctual lights and emitters
  std::vector<Rgb> sky;
};
/// `skyRays` a patch.
PatchLight lightPatches(const Scene&, const Tracer&, const PatchMesh&, const DirectLight&, const DirectMap&, const Run&,
                        std::uint32_t skyRays = 64);
/// What the noise of the sky on patches, which both halves of a map share, asks for at a goal.
std::uint32_t patchSkyRaysFor(double goal);

/// A solution: illuminance by at least one bounce on each patch [lx].
using Bounced = std::vector<Rgb>;

/// Exitance of the level as hemisphere rays see it. Two independent solutions, one for each half of a texel's rays, let the noise of the
/// solver show in the difference of the halves; a coarse copy (means over groups of patches twice the size) shows what patch size costs.
class Field {
 public:
  /// `coarser`: a solution that the coarse copy is made of instead (links of the round before); may be nullptr.
  /// `compact`: what texels show is put together at each hit, in 16 bytes a texel instead of 64; the same bits.
  Field(const Scene&, const PatchMesh&, const DirectMap&, const TexelMap&, const PatchLight&, std::array<const Bounced*, 2> solutions,
        const Bounced* coarser, const Run&, bool compact = false);
  ~Field();
  struct Seen {
    Rgb exitance{0.0f};   ///< B [lm/m^2]; emitted light is not in it
    Rgb coarse{0.0f};     ///< the same from patches twice the size
    float size_m = 0.0f;  ///< of the patch
  };
  Seen at(const Hit&, int half) const;

  /// Reflectance of the side that was hit; nullptr where it reflects nothing.
  const Rgb* reflectanceAt(const Hit&) const;
  /// Direct light at the very place, where the map knows it for sure; nullptr at edges of shadows, off the map, on backs.
  const Rgb* sureDirectAt(const Hit&) const;

 private:
  const Scene& scene_;
  const PatchMesh& mesh_;
  DirectMap map_;
  // Where a hit's texel is, and what it shows, each in one place of memory: rays go everywhere, and a cache miss costs as much as half a
  // ray.
  struct TriangleUv {
    glm::vec2 corner, e1, e2;     // in texels of the map
    std::uint32_t chart = kNone;  // kNone = its front has no texels
  };
  struct TexelSeen {
    Seen seen;  // that of the patch under the texel's middle, with the texel's own direct light
    std::uint32_t chart = kNone;
  };
  std::vector<TriangleUv> uvs_;
  std::array<std::vector<Seen>, 2> patches_;     // of each half
  std::array<TexelArray<TexelSeen>, 2> texels_;  // empty when compact
  struct Parts;                                  // of what texels show
  std::unique_ptr<Parts> parts_;                 // compact only
};

}  // namespace lmc
