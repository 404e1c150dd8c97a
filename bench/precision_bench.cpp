/// What float costs in accuracy and double in time, in the places where lmc decided for one of them. Prints Markdown; the truth is long
/// double.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "libscene/rng.h"

namespace {

using lmc::combine;

double uniform(std::uint64_t name, std::uint64_t k) { return double(combine(name, k) >> 11) * 0x1p-53; }

template <class F>
double nanoseconds(std::size_t calls, F&& f) {
  double best = INFINITY;
  for (int round = 0; round < 5; ++round) {
    const auto start = std::chrono::steady_clock::now();
    for (std::size_t k = 0; k < calls; ++k) f(k);
    best = std::min(best, std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - start).count() / double(calls));
  }
  return best;
}

template <class T>
using Vec = std::array<T, 3>;
template <class T>
Vec<T> cross(const Vec<T>& a, const Vec<T>& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
template <class T>
T dot(const Vec<T>& a, const Vec<T>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// Form factor of a place, whose normal is (1, 1/2, 1), to a square by Lambert's sum over edges, angles by atan2 [lambert1760]: the edges'
/// parts are of both signs and nearly cancel where the square is small.
template <class T>
T squareFrom(T distance, T aside) {
  const std::array<Vec<T>, 4> corner{{{aside - T(0.5), T(-0.5), distance},
                                      {aside + T(0.5), T(-0.5), distance},
                                      {aside + T(0.5), T(0.5), distance},
                                      {aside - T(0.5), T(0.5), distance}}};
  T sum = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const Vec<T>&a = corner[k], &b = corner[(k + 1) % 4];
    const Vec<T> c = cross(a, b);
    const T length = std::sqrt(dot(c, c));
    sum += std::atan2(length, dot(a, b)) * (c[0] + T(0.5) * c[1] + c[2]) / (T(1.5) * length);
  }
  return sum / (T(2) * std::numbers::pi_v<T>);
}

void formFactors() {
  fmt::print(
      "Form factor of a place to a unit square that is tilted and 1 aside (`form_factor.cpp`: double):\n\n| distance | F | float off by | "
      "double off by "
      "|\n|---|---|---|---|\n");
  for (const double d : {0.01, 0.1, 1.0, 10.0, 100.0, 1000.0, 10000.0}) {
    const long double exact = squareFrom<long double>((long double)(d), 1.0L);
    const auto off = [&](long double v) { return std::abs(double((v - exact) / exact)); };
    fmt::print("| {:g} | {:.3g} | {:.1e} | {:.1e} |\n", d, double(exact), off(squareFrom<float>(float(d), 1.0f)),
               off(squareFrom<double>(d, 1.0)));
  }
  volatile float f = 0.0f;
  volatile double g = 0.0;
  const double a = nanoseconds(200000, [&](std::size_t k) { f = squareFrom<float>(1.0f + float(k) * 1e-6f, 1.0f); }),
               b = nanoseconds(200000, [&](std::size_t k) { g = squareFrom<double>(1.0 + double(k) * 1e-6, 1.0); });
  fmt::print("\nTime: {:.0f} ns in float, {:.0f} ns in double ({:.2f} times).\n\n", a, b, b / a);
}

/// How far a place, put together from its triangle's corners, lies off the triangle's plane.
template <class T>
double offPlane(double offset_m, std::uint64_t k) {
  std::array<Vec<double>, 3> corner;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t c = 0; c < 3; ++c)
      corner[i][c] = double(float(offset_m + 4.0 * uniform(combine(1, k), 3 * i + c)));  // floats, as in the file
  const T u = T(uniform(combine(2, k), 0)), v = T(uniform(combine(2, k), 1)) * (T(1) - u);
  Vec<T> p;
  for (std::size_t c = 0; c < 3; ++c) p[c] = (T(1) - u - v) * T(corner[0][c]) + u * T(corner[1][c]) + v * T(corner[2][c]);
  Vec<double> e1, e2, to;
  for (std::size_t c = 0; c < 3; ++c) {
    e1[c] = corner[1][c] - corner[0][c];
    e2[c] = corner[2][c] - corner[0][c];
    to[c] = double(p[c]) - corner[0][c];
  }
  const Vec<double> n = cross(e1, e2);
  return std::abs(dot(n, to)) / std::sqrt(dot(n, n));
}

void places() {
  fmt::print(
      "Places on triangles of 4 m, off their plane, largest of 100,000 (`texels.cpp`: double, then moved 4 ulp along the normal):\n\n"
      "| level's corner at | ulp there | float | double |\n|---|---|---|---|\n");
  for (const double offset : {0.0, 100.0, 10000.0}) {
    double f = 0.0, d = 0.0;
    for (std::uint64_t k = 0; k < 100000; ++k) {
      f = std::max(f, offPlane<float>(offset, k));
      d = std::max(d, offPlane<double>(offset, k));
    }
    const float largest = float(offset + 4.0);
    const double ulp = double(std::nextafter(largest, INFINITY) - largest);
    fmt::print("| {:g} m | {:.2g} m | {:.2f} ulp | {:.1e} ulp |\n", offset, ulp, f / ulp, d / ulp);
  }
  fmt::print("\n");
}

void sums() {
  fmt::print(
      "Sum of n values from 0 to 1, one after the other, RMS of 64 sums (rays of a texel are summed in double, and by tens of rays in "
      "float: "
      "`gather.cpp`, `map_hemisphere.cpp`):\n\n| n | float off by | batches of 256 in double, those in float | double off by "
      "|\n|---|---|---|---|\n");
  for (const std::size_t n : {256u, 4096u, 16384u, 1048576u}) {
    double f2 = 0.0, m2 = 0.0, d2 = 0.0;
    for (std::uint64_t s = 0; s < 64; ++s) {
      float f = 0.0f, mixed = 0.0f;
      double d = 0.0, batch = 0.0;
      long double exact = 0.0L;
      for (std::size_t k = 0; k < n; ++k) {
        const float v = float(uniform(combine(3, s), k));
        f += v;
        d += double(v);
        batch += double(v);
        exact += (long double)(v);
        if (k % 256 == 255) {
          mixed += float(batch);
          batch = 0.0;
        }
      }
      const auto off2 = [&](long double v) { return std::pow(double((v - exact) / exact), 2.0) / 64.0; };
      f2 += off2(f);
      m2 += off2(mixed);
      d2 += off2(d);
    }
    fmt::print("| {} | {:.1e} | {:.1e} | {:.1e} |\n", n, std::sqrt(f2), std::sqrt(m2), std::sqrt(d2));
  }
  fmt::print("\n");
}

/// Light in a closed room of n patches of one reflectance, conjugate gradients on the symmetric system, all in T.
template <class T>
std::vector<T> solved(const std::vector<float>& exchange, std::size_t n, double rho) {
  std::vector<T> x(n, T(0)), r(n), p(n), q(n);
  for (std::size_t i = 0; i < n; ++i) r[i] = p[i] = T(i < n / 8 ? 1.0 : 0.0);
  const auto sumOf = [&](const std::vector<T>& a, const std::vector<T>& b) {
    T sum = 0;
    for (std::size_t i = 0; i < n; ++i) sum += a[i] * b[i];
    return sum;
  };
  T rr = sumOf(r, r);
  for (int k = 0; k < 200 && rr > T(0); ++k) {
    for (std::size_t i = 0; i < n; ++i) {
      T sum = 0;
      for (std::size_t j = 0; j < n; ++j) sum += T(exchange[i * n + j]) * p[j];
      q[i] = p[i] - T(rho) * sum;
    }
    const T alpha = rr / sumOf(p, q);
    for (std::size_t i = 0; i < n; ++i) {
      x[i] += alpha * p[i];
      r[i] -= alpha * q[i];
    }
    const T next = sumOf(r, r);
    if (!(next < rr) && k > 20) break;
    for (std::size_t i = 0; i < n; ++i) p[i] = r[i] + next / rr * p[i];
    rr = next;
  }
  return x;
}

void solver() {
  constexpr std::size_t n = 128;
  // A symmetric exchange whose rows sum to 1, as scaling leaves it.
  std::vector<double> f(n * n);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j <= i; ++j) f[i * n + j] = f[j * n + i] = i == j ? 0.0 : uniform(combine(5, i), j);
  for (int round = 0; round < 200; ++round) {
    std::vector<double> row(n, 0.0);
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = 0; j < n; ++j) row[i] += f[i * n + j];
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = 0; j < n; ++j) f[i * n + j] /= std::sqrt(row[i] * row[j]);
  }
  const std::vector<float> stored(f.begin(), f.end());
  fmt::print(
      "Bounced light of a closed room, {} patches, form factors kept in float (`solve.cpp`: sums and vectors in double):\n\n"
      "| albedo | vectors and sums in float, off by | in double, off by |\n|---|---|---|\n",
      n);
  for (const double rho : {0.5, 0.9, 0.99, 0.999}) {
    const std::vector<long double> exact = solved<long double>(stored, n, rho);
    const auto off = [&](const auto& x) {
      double square = 0.0, all = 0.0;
      for (std::size_t i = 0; i < n; ++i) {
        square += std::pow(double((long double)(x[i]) - exact[i]), 2.0);
        all += std::pow(double(exact[i]), 2.0);
      }
      return std::sqrt(square / all);
    };
    fmt::print("| {:g} | {:.1e} | {:.1e} |\n", rho, off(solved<float>(stored, n, rho)), off(solved<double>(stored, n, rho)));
  }
  volatile double keep = 0.0;
  const double a = nanoseconds(1, [&](std::size_t) { keep = double(solved<float>(stored, n, 0.9)[0]); }),
               b = nanoseconds(1, [&](std::size_t) { keep = solved<double>(stored, n, 0.9)[0]; });
  fmt::print("\nTime: {:.2f} ms in float, {:.2f} ms in double.\n", a * 1e-6, b * 1e-6);
}

}  // namespace

int main() {
  formFactors();
  places();
  sums();
  solver();
  return 0;
}
