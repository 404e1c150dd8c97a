#include "libradiosity/zonal.h"

#include <algorithm>
#include <cmath>

namespace lmc {

ZonalSolution solveZonal(std::span<const long double> factors, std::span<const long double> emission, std::span<const long double> albedo) {
  const std::size_t n = emission.size();
  std::vector<long double> a(n * n), b(emission.begin(), emission.end());
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j) a[i * n + j] = (i == j ? 1.0L : 0.0L) - albedo[i] * factors[i * n + j];
  // Rows are diagonally dominant (albedo times a row sum of at most 1): no pivoting.
  for (std::size_t k = 0; k < n; ++k)
    for (std::size_t i = k + 1; i < n; ++i) {
      const long double f = a[i * n + k] / a[k * n + k];
      if (f == 0.0L) continue;
      for (std::size_t j = k; j < n; ++j) a[i * n + j] -= f * a[k * n + j];
      b[i] -= f * b[k];
    }
  ZonalSolution out;
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t j = i + 1; j < n; ++j) b[i] -= a[i * n + j] * b[j];
    b[i] /= a[i * n + i];
  }
  out.radiosity = b;
  for (std::size_t i = 0; i < n; ++i) {
    long double h = 0.0L;
    for (std::size_t j = 0; j < n; ++j) h += factors[i * n + j] * b[j];
    out.illuminance.push_back(h);
  }
  return out;
}

std::array<Polygon3, 6> boxFaces(double a, double b, double c) {
  using V = glm::dvec3;
  const auto face = [](V o, V u, V v) { return Polygon3{o, o + u, o + u + v, o + v}; };
  const V A(a, 0, 0), B(0, b, 0), C(0, 0, c), O(0);
  return {face(O, A, B), face(C, B, A), face(O, B, C), face(A, C, B), face(O, C, A), face(B, A, C)};
}

std::vector<long double> boxFactors(double a, double b, double c) {
  const std::array<Polygon3, 6> faces = boxFaces(a, b, c);
  const long double area[6] = {(long double)(a)*b, (long double)(a)*b, (long double)(b)*c,
                               (long double)(b)*c, (long double)(a)*c, (long double)(a)*c};
  std::vector<long double> f(36, 0.0L);
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t j = i + 1; j < 6; ++j) {
      const long double exchange = exchangeAreaExtended_m2(faces[i], faces[j]);
      f[i * 6 + j] = exchange / area[i];
      f[j * 6 + i] = exchange / area[j];
    }
  return f;
}

double seriesTerms(long double albedo, long double rest) {
  if (!(albedo > rest)) return 1.0;
  // ceil of the quotient of logarithms, and a look at its neighbour: the quotient may be a whole number.
  long double k = std::max(1.0L, std::ceil(std::log(rest) / std::log(albedo)) - 1.0L);
  while (std::pow(albedo, k) > rest * (1.0L + 1e-15L)) k += 1.0L;
  return double(k);
}

}  // namespace lmc
