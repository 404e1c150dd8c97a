#pragma once
/// The dense reference solver: every pair of patches, form factors by the ladder of methods, closure and reciprocity kept, conjugate
/// gradients. For up to a few thousand patches; the oracle of tests.
#include "libradiosity/shoot.h"

namespace lmc {

inline constexpr std::size_t kMaxDensePatches = 4096;

/// Exchange areas A_i F_ij [m^2], symmetric: reciprocity holds by construction.
struct FormFactors {
  std::size_t size = 0;
  std::vector<float> exchange_m2;  ///< rows of `size`
  std::vector<double> closure;     ///< of each row: share of what leaves i that meets a front, by rays
  double closureError = 0.0;       ///< area mean of |sum_j F_ij - closure_i| before rows and columns were scaled to it
  double at(std::size_t i, std::size_t j) const { return double(exchange_m2[i * size + j]); }
};

/// Unoccluded A_i F_ij of two patches [m^2], by distance over size: disc form far, Lambert at points nearer, contour integral near and
/// touching.
double exchangeArea_m2(const Scene&, const PatchMesh&, std::uint32_t i, std::uint32_t j);

FormFactors computeFormFactors(const Scene&, const Tracer&, const PatchMesh&, const Run&);

struct SolveOptions {
  double maxRelativeResidual = 1e-6;  ///< stop when |b - (I - S) x| <= this * |b|, each channel
  int maxIterations = 500;
};

/// H of B = rho (E + H), H_i = sum_j F_ij B_j, solved as (I - S) x = b with S = R^1/2 D R^1/2, D_ij = A_i F_ij/sqrt(A_i A_j), x_i = B_i
/// sqrt(A_i/rho_i) (methods: 6..9 iterations at any albedo). Patches with rho = 0 stay out of x. Solution::passes counts iterations.
Solution solveDense(const PatchMesh&, const FormFactors&, const PatchLight&, const SolveOptions&);

}  // namespace lmc
