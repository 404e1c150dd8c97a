#pragma once
/// Patches: the unknowns of the radiosity system (OpenMesh only in patch_mesh.cpp). A patch is a part of a triangle or a group of adjacent
/// parts of like normal and reflectance, so that the number of patches follows their size and not the number of triangles.
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "libscene/run.h"
#include "libscene/scene.h"

namespace lmc {

struct Hit;  // tracer.h

/// A part of a scene triangle that belongs to one patch: the corners' weights of the triangle's second and third corner.
struct Leaf {
  std::uint32_t triangle = 0;
  std::array<glm::vec2, 3> bary;
  float area_m2 = 0.0f;  ///< without holes
};

struct Patch {
  double area_m2 = 0.0;  ///< holes of Mask materials and (after exposePatches) buried parts taken off
  glm::dvec3 centre_m{0.0};
  glm::dvec3 normal{0.0};  ///< unit; towards the side that it stands for
  double radius_m = 0.0;   ///< of the sphere about centre_m that holds it
  Rgb reflectance{0.0f};   ///< area mean
  float size_m = 0.0f;     ///< side of the square that it is meant to be
  std::uint8_t level = 0;  ///< how often PatchMesh::size_m was halved for it
  std::uint32_t object = 0;
  std::uint32_t firstLeaf = 0, leafCount = 0;
  // Where the first ray of each exposed place went (after exposePatches): what leaves the patch meets fronts, backs or nothing.
  std::uint8_t fronts = 0, backs = 0, left = 0;
  std::uint16_t exposed = 0xffff;  ///< which of its kPatchPlaces places see something else than the inside of a solid
  bool back = false;               ///< the back of a double-sided material: leaves run clockwise seen from this side
};

inline constexpr float kMostReflectance = 0.999f;  ///< that can be solved: at 1 a closed room has no finite solution
inline constexpr std::uint32_t kPatchPlaces = 16;  ///< fixed places on each patch, of sequence(seed, Draw::PatchDirect, 0, 0, patch, 0, 0)

/// Light that leaves a place, as far as it is known before the bounces are solved.
struct LightAt {
  std::uint32_t triangle = 0;
  glm::vec2 bary{0.0f};
  float area_m2 = 0.0f;  ///< that it stands for
  float exitance = 0.0f;
};

struct PatchOptions {
  double size_m = 0.5;                ///< side of the square that a patch is meant to be where light is even
  std::uint32_t maxPatches = 200000;  ///< above it the size grows until they fit
  std::uint8_t levels = 0;            ///< where `light` changes over a patch its size is halved up to so often
  std::span<const LightAt> light{};   ///< places all over the level; empty = one size everywhere
  double mostMoved = 0.5;             ///< light that a mean may put at other places of a patch, in mean exitance * finest size^2
  double maxBend_rad = 0.35;          ///< normals of a group differ by no more from its first one
};

struct PatchMesh {
  std::vector<Patch> patches;
  std::vector<Leaf> leaves;    ///< of a patch: contiguous
  double size_m = 0.0;         ///< PatchOptions::size_m as used: of the coarsest patches
  std::uint64_t unjoined = 0;  ///< triangles that a non-manifold edge keeps apart from their neighbours

  /// The patch seen at a place of a triangle from its front or back; kNone where that side reflects nothing (back of a one-sided material).
  std::uint32_t patchAt(std::uint32_t triangle, glm::vec2 bary, bool front) const;

  /// The same for many hits, which takes far less time where the mesh is larger than the caches; kNone also where nothing was hit.
  void patchesAt(std::span<const Hit> hits, std::span<std::uint32_t> out) const;

  /// A place on the patch, uniform by area for u uniform in the unit square; weights for surfacePoint().
  std::pair<std::uint32_t, glm::dvec2> sample(const Patch&, glm::vec2 u) const;

  // Where a triangle was halved: child[0] holds the first corner of the cut edge. A node without children is a leaf of `patch`.
  struct Node {
    std::array<std::uint32_t, 2> child{kNone, kNone};
    std::uint32_t patch = kNone;
    std::uint8_t edge = 0;  ///< the edge from corner `edge` to the next was cut in the middle
    bool twoSided = false;  ///< the back is patch + 1
  };
  std::vector<Node> nodes;  ///< the first ones are the scene's triangles, by number
};

/// Patches of everything that reflects: cast, not Blend, not degenerate.
PatchMesh makePatches(const Scene&, const PatchOptions&, const Run&);

/// An edge of the surface at which two triangles meet, fronts on the same side.
struct SharedEdge {
  std::array<std::uint32_t, 2> triangle;
  std::array<glm::uvec2, 2> vertex;  ///< its ends as vertices of either triangle: vertex[0].x and vertex[1].x are one place
};

/// Edges that two of the wanted triangles share, whatever their objects: corners nearer than 4 ulp of the level's extent are one. Where the
/// surface is not manifold, or an end of one triangle lies within the other's edge, none is shared.
std::vector<SharedEdge> sharedEdges(const Scene&, const std::function<bool(std::uint32_t)>& wanted);

/// The size of patches that cuts the level into about `squares` of them. A sliver counts by its length, for it is cut along it. [m]
double patchSizeFor_m(const Scene&, double squares);

}  // namespace lmc
