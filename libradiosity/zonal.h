#pragma once
/// Enclosures of few zones with known factors: small linear algebra in extended precision, for with albedos near 1 the answer is what
/// little is left of large sums.
#include <array>
#include <span>
#include <vector>

#include "libradiosity/form_factor.h"

namespace lmc {

struct ZonalSolution {
  std::vector<long double> radiosity;    ///< B = M + rho H [lm/m^2]
  std::vector<long double> illuminance;  ///< H_i = sum_j F_ij B_j [lx]
};

/// B_i - rho_i sum_j F_ij B_j = M_i by Gaussian elimination; `factors` in rows. [goral1984]
ZonalSolution solveZonal(std::span<const long double> factors, std::span<const long double> emission, std::span<const long double> albedo);

/// Factors between the six faces of an a x b x c box in the order z=0, z=c, x=0, x=a, y=0, y=b; rows sum to 1.
std::vector<long double> boxFactors(double a, double b, double c);

/// The faces themselves, fronts inwards, in the same order.
std::array<Polygon3, 6> boxFaces(double a, double b, double c);

/// Number of terms of 1 + rho + rho^2 ... (emission counted) until the rest is at most `rest` of the sum: smallest k >= 1 with rho^k <=
/// rest.
double seriesTerms(long double albedo, long double rest);

}  // namespace lmc
