#pragma once
/// Spatially partitioned visibility: what two clusters can be told about each other without a ray. Every answer is conservative (a pair is
/// settled only when no ray could say otherwise) and holds for all parts of both clusters, which inherit it.
#include <array>
#include <atomic>
#include <cstdint>
#include <string_view>
#include <vector>

#include "libradiosity/cells.h"
#include "libradiosity/cluster_tree.h"
#include "libscene/tracer.h"

namespace lmc {

enum class Rule : std::uint8_t { Facing, Cells, Empty, Blocked };
inline constexpr std::size_t kRules = 4;
inline constexpr std::array<const char*, kRules> kRuleNames{"facing", "cells", "empty", "blocked"};

struct PartitionOptions {
  std::array<bool, kRules> on{true, true, true, true};
  bool automatic = true;  ///< a rule that does not pay is left out from then on
};

/// What a rule has done, summed over pairs in their order: the same for any number of threads (but for `seconds`).
struct RuleCount {
  std::uint64_t asked = 0, settled = 0;
  std::uint64_t raysSaved = 0;  ///< that the pairs would have been given
  double seconds = 0.0;         ///< of its own, from every 64th question
  bool on = false;              ///< at the end
};

class Partition {
 public:
  /// What rules that are off would need is not made.
  Partition(const Scene&, const PatchMesh&, const ClusterTree&, const Tracer&, const PartitionOptions&, const Run&);

  /// No place of one is in front of any place of the other.
  bool averted(const Cluster&, const Cluster&) const;
  /// Rooms: no line leads from the cells that one node looks into through portals to those of the other. By numbers of nodes.
  bool apart(std::uint32_t a, std::uint32_t b) const;
  /// Nothing reaches into the convex hull of both boxes but surfaces that have both clusters on one side: V = 1.
  bool emptyShaft(const Cluster&, const Cluster&) const;
  /// One convex flat surface without holes cuts the hull of both boxes in two: V = 0.
  bool blockedShaft(const Cluster&, const Cluster&) const;

  std::size_t occluders() const { return occluders_.size(); }
  /// Whether some two patches are apart; else the rule has nothing to say.
  bool hasRooms() const { return !sets_.empty(); }

 private:
  struct Occluder {
    glm::dvec3 normal{0.0};
    double lowest = 0.0, highest = 0.0;  // of its places along the normal
    glm::dvec3 u{0.0}, v{0.0};
    std::vector<glm::dvec2> corner;  // convex, counter-clockwise in (u, v)
  };
  void findOccluders(const Scene&, const PatchMesh&, const Tracer&);
  void findRooms(const Scene&, const PatchMesh&, const Run&);

  const ClusterTree& tree_;
  double slack_m_;  // rounding of boxes, offsets and ray starts
  std::vector<Occluder> occluders_;
  Cells cells_;
  std::vector<std::uint32_t> setOf_;  // of a node: the set of cells that its patches look into; empty without rooms
  std::vector<std::uint64_t> sets_;   // of each set its cells, then all cells that they may see
};

}  // namespace lmc
