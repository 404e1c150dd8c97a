#pragma once
/// Quadrature for integrands of one sign: nothing cancels, so that small results keep all their digits.
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

namespace lmc {

/// Nodes and weights on [0, 1].
template <class Real, std::size_t N>
struct GaussLegendre {
  std::array<Real, N> node, weight;
};

/// By Newton's method on the Legendre polynomial, to the last digit of Real.
template <class Real, std::size_t N>
const GaussLegendre<Real, N>& gaussLegendre() {
  static const GaussLegendre<Real, N> rule = [] {
    GaussLegendre<Real, N> r;
    for (std::size_t i = 0; i < N; ++i) {
      Real x = std::cos(Real(3.14159265358979323846264338327950288L) * (Real(i) + Real(0.75)) / (Real(N) + Real(0.5))), slope = 0;
      for (int step = 0; step < 100; ++step) {
        Real before = 1, now = x;
        for (std::size_t k = 2; k <= N; ++k) {
          const Real next = (Real(2 * k - 1) * x * now - Real(k - 1) * before) / Real(k);
          before = now;
          now = next;
        }
        slope = Real(N) * (x * now - before) / (x * x - 1);
        const Real by = now / slope;
        x -= by;
        if (std::abs(by) < 2 * std::numeric_limits<Real>::epsilon()) break;
      }
      r.node[i] = (1 - x) / 2;
      r.weight[i] = 1 / ((1 - x * x) * slope * slope);
    }
    return r;
  }();
  return rule;
}

/// int_a^b f by panels of 16 points that halve until none is longer than `distance(middle)`, the distance of the integrand's nearest
/// singularity from the panel's middle: then the error is below 1e-17 of a panel's share.
template <class F, class D>
double integrateGraded(double a, double b, const F& f, const D& distance, int depth = 60) {
  const double mid = 0.5 * (a + b);
  if (depth > 0 && !(b - a <= distance(mid)) && a < mid && mid < b)
    return integrateGraded(a, mid, f, distance, depth - 1) + integrateGraded(mid, b, f, distance, depth - 1);
  const auto& rule = gaussLegendre<double, 16>();
  double sum = 0.0;
  for (std::size_t k = 0; k < 16; ++k) sum += rule.weight[k] * f(a + (b - a) * rule.node[k]);
  return (b - a) * sum;
}

/// int_a^b f by the double-exponential rule: right for integrands that are smooth inside and have roots or poles of low order at the
/// ends. f(x, x - a), the difference without cancellation.
template <class F>
double integrateTanhSinh(double a, double b, const F& f) {
  constexpr double kStep = 1.0 / 32.0, kEnd = 3.4;  // at 3.4 the weight is below 1e-19
  constexpr double kHalfPi = 1.57079632679489661923;
  double sum = 0.0;
  for (int k = -int(kEnd / kStep); k <= int(kEnd / kStep); ++k) {
    const double t = k * kStep, u = kHalfPi * std::sinh(t);
    // Share of the way from a, and from b: 1/(1 + exp(-+2u)).
    const double fromA = 1.0 / (1.0 + std::exp(-2.0 * u)), fromB = 1.0 / (1.0 + std::exp(2.0 * u));
    const double weight = 2.0 * kHalfPi * std::cosh(t) * fromA * fromB;
    const double x = fromA < 0.5 ? a + (b - a) * fromA : b - (b - a) * fromB;
    const double value = f(x, (b - a) * fromA);
    sum += weight * value;
  }
  return sum * kStep * (b - a);
}

}  // namespace lmc
