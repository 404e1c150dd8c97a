#pragma once
/// Progressive shooting, the lecture's way: every patch sends what it has not yet sent, pass after pass. P_j += P_i F_ij; what arrives,
/// times rho, is sent in the next pass. F_ij is never stored: rays from places on i in cosine directions carry its power to the patches
/// that they hit, so that near and touching patches are right and no light is made or lost.
#include <functional>

#include "libradiosity/field.h"

namespace lmc {

enum class Stop { Energy, Passes, Nothing };

struct ShootOptions {
  double maxTail = 1e-3;       ///< stop when what is unsent can add no more than this share of the light (Solution::tail <= this)
  int maxPasses = -1;          ///< stop after so many passes; negative = no limit
  double raysPerPatch = 64.0;  ///< of the first pass, mean; later passes in proportion to what is left, never below kLeastRaysPerPatch
  std::uint32_t stream = 0;    ///< independent random numbers for each
  std::function<void(int pass, const Bounced&)> onPass;  ///< a picture after each pass
};

/// Light in lumens; each sum is counted by itself, so that balance() can fail.
struct Energy {
  glm::dvec3 sent{0.0};      ///< sum of A rho E_direct (sky included)
  glm::dvec3 absorbed{0.0};  ///< sum of A (1 - rho) H
  glm::dvec3 backs{0.0};     ///< taken by backs of one-sided surfaces
  glm::dvec3 left{0.0};      ///< out of the level
  glm::dvec3 unsent{0.0};    ///< still to be sent when the passes ended
  /// |in - out| / in, the worst channel; infinite where a sum is not finite.
  double imbalance() const;
};

struct Solution {
  Bounced illuminance;  ///< H [lx], one a patch
  Energy energy;
  Stop stop = Stop::Nothing;
  int passes = 0;
  /// Upper bound of the exitance left out, as a share of what there is: unsent rho/(1 - rho) / (sent first + rho * arrived), rho the
  /// largest one. (What is unsent itself is exitance, too, and is seen by hemisphere rays.)
  double tail = 0.0;
  double tailEstimate = 0.0;  ///< the same by the factor at which the last pass fell
};

Solution shoot(const Scene&, const Tracer&, const PatchMesh&, const PatchLight&, const ShootOptions&, const Run&);

}  // namespace lmc
