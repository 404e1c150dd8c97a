#pragma once
/// Rays stored, light solved: every patch casts the same number of rays once and keeps whom they met. Hits both ways are one unbiased
/// estimate of each exchange area, so that reciprocity holds by construction, and conjugate gradients carry all bounces over them.
#include "libradiosity/shoot.h"

namespace lmc {

struct StoredOptions {
  std::uint32_t rays = 32;   ///< of a patch, mean
  std::uint32_t stream = 0;  ///< independent random numbers for each
  double maxTail = 1e-3;     ///< stop iterating when what is left out is no more than this share of the light, and of each part's
  int maxIterations = 500;
  std::uint64_t maxBytes = ~std::uint64_t(0);  ///< for hits: 8 bytes a ray, or 4 at half the speed, or none and every sweep casts again
};

/// Rays of a patch for a relative RMS error of the map: the field's error goes with 1/sqrt(all rays), patches go with 1/goal, and so rays a
/// patch do, too. Few patches are seen large, and get more.
std::uint32_t storedRaysFor(double goal, std::size_t patches);

struct StoredSolution {
  Solution solution;
  std::uint64_t bytes = 0;    ///< of stored hits; StoredOptions::maxBytes changes nothing else
  double closureError = 0.0;  ///< area mean of |row sum - closure| before scaling: the noise of hits from the other side
};

/// `mesh` after exposePatches.
StoredSolution solveStored(const Scene&, const Tracer&, const PatchMesh&, const PatchLight&, const StoredOptions&, const Run&);

}  // namespace lmc
