#pragma once
/// The solver for levels: links between clusters refined where the light asks for it, energy closed by what rays found, conjugate
/// gradients. Gathers only and sums in a fixed order: the same bits for any number of threads.
#include "libradiosity/links.h"

namespace lmc {

struct HierarchicalOptions {
  double goal = 0.02;     ///< relative RMS error of the map; links get kLinkShare of it
  double maxTail = 1e-3;  ///< stop iterating when what is left out is no more than this share of the light, and of each part's
  int maxIterations = 500;
  std::uint64_t maxLinks = 40'000'000;  ///< part of the result: when they would be more, the threshold rises
  PartitionOptions partition;
};

struct HierarchicalSolution {
  Solution fine;
  Bounced coarse;  ///< illuminance by the links of the round before: what they still change
  LinkStats stats;
  double linkError = 0.0;     ///< RMS of fine - coarse over the patches' area, relative to the mean illuminance, direct included
  double closureError = 0.0;  ///< area mean of |row sum - closure| before scaling
};

/// `mesh` after exposePatches.
HierarchicalSolution solveHierarchical(const Scene&, const Tracer&, const PatchMesh&, const PatchLight&, const HierarchicalOptions&,
                                       const Run&);

}  // namespace lmc
