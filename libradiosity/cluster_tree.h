#pragma once
/// Clusters of patches: a binary tree whose leaves are patches, cut where boxes and normal cones become tight. Links stand between its
/// nodes.
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "libradiosity/patch_mesh.h"

namespace lmc {

inline constexpr std::size_t kPlaces = 4;

/// A part of a cluster as quadrature sees it.
struct Place {
  glm::vec3 position_m{0.0f};
  glm::vec3 normal{0.0f};  ///< area mean: shorter than 1 where the part is bent
  float share = 0.0f;      ///< of the cluster's area
  glm::vec3 slope{0.0f};   ///< values at places -> least-squares gradient: sum of value * slope, in values per radius
};

struct Cluster {
  glm::vec3 lo_m{0.0f}, hi_m{0.0f};         ///< box of its patches
  glm::vec3 centre_m{0.0f};                 ///< of the box
  float radius_m = 0.0f;                    ///< of a sphere about centre_m that holds it
  glm::vec3 axis{0.0f};                     ///< of its normal cone, unit; 0 = no cone holds the normals
  float cosine = -1.0f;                     ///< of the cone's half angle
  float lowest_m = 0.0f, highest_m = 0.0f;  ///< dot(axis, place) of all places
  std::uint32_t child = kNone;              ///< the other is child + 1; kNone = one patch
  std::uint32_t parent = kNone;
  std::uint32_t first = 0, count = 0;  ///< of ClusterTree::order
  glm::vec3 centroid_m{0.0f};          ///< by area
  double area_m2 = 0.0;
  bool isLeaf() const { return child == kNone; }
  bool flat() const { return cosine > 0.999999f; }  ///< within 1.4 mrad
};

struct ClusterTree {
  std::vector<Cluster> nodes;                      ///< the root first, parents before their children
  std::vector<std::uint32_t> order;                ///< all patches, those of a node contiguous
  std::vector<double> areaBefore;                  ///< of `order`, one entry more [m^2]
  std::vector<std::array<Place, kPlaces>> places;  ///< of each node: its grandchildren, or quarters of a patch
  std::vector<std::uint32_t> leafOf;               ///< of a patch: its node
  /// The number in `order` at a share u of the node's area, and how far into that patch (uniform again).
  std::pair<std::uint32_t, float> pick(const Cluster&, float u) const;
  std::uint32_t patchOf(const Cluster& leaf) const { return order[leaf.first]; }
};

ClusterTree makeClusters(const Scene&, const PatchMesh&, const Run&);

/// Patches of the 64 or so largest parts of the tree: nodes of at most `patches` patches whose parents have more.
std::vector<std::uint32_t> parts(const ClusterTree&, std::size_t patches);

}  // namespace lmc
