#pragma once
/// Least squares for seams (Ceres only in seam_solve.cpp).
#include <array>
#include <cstdint>
#include <vector>

namespace lmc {

/// A difference that is to vanish: constant + sum of weight[k] * x[unknown[k]].
struct SeamEquation {
  std::array<std::uint32_t, 8> unknown{};  ///< each once
  std::array<double, 8> weight{};
  std::uint32_t count = 0;
  double constant = 0.0;
  double strength = 1.0;  ///< what it counts by, beside (x - value)/sigma
};

struct SeamSystem {
  std::vector<double> value;  ///< to stay near to
  std::vector<double> sigma;  ///< by how much x may be off; positive
  std::vector<double> limit;  ///< |x - value| <= limit
  std::vector<SeamEquation> equations;
};

/// x that makes sum ((x - value)/sigma)^2 + sum (strength * difference)^2 least, but for this: what comes out beyond its limit is put there
/// and stays, and the rest is solved for again. One thread, and the same bits every time. Time: linear where equations join few unknowns in
/// a row, as along a seam.
std::vector<double> solveSeams(const SeamSystem&);

}  // namespace lmc
