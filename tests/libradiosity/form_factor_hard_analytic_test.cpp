/// Form factors where the plain formulas lose their digits: far, near, thin, grazing; bodies; against quadrature by brute force.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "libradiosity/form_factor_bodies.h"
#include "libradiosity/quadrature.h"
#include "libscene/constants.h"

namespace lmc {
namespace {

using V = glm::dvec3;

Polygon3 rectangle(V o, V u, V v) { return {o, o + u, o + u + v, o + v}; }

/// F of an element at the origin facing +z over a disc or polygon given by its places: a fine product rule on [0, 1]^2.
template <class F>
double brute(const F& f) {
  const auto& rule = gaussLegendre<double, 64>();
  double sum = 0.0;
  for (std::size_t i = 0; i < 64; ++i)
    for (std::size_t k = 0; k < 64; ++k) sum += rule.weight[i] * rule.weight[k] * f(rule.node[i], rule.node[k]);
  return sum;
}

TEST(FarElement, KeepsItsDigitsAtAnyDistance) {
  // The kernel over a unit square in plane z = h, in extended precision, by the same brute force.
  for (const double h : {20.0, 1e3, 1e6, 1e9}) {
    const V at(0.75 * h, -0.5 * h, h);
    const double exact = brute([&](double a, double b) {
      const long double x = at.x + a, y = at.y + b, r2 = x * x + y * y + (long double)(h)*h;
      return double((long double)(h)*h / (r2 * r2)) / kPi;
    });
    const double got = elementToPolygon(V(0), V(0, 0, 1), rectangle(at, V(0, 1, 0), V(1, 0, 0)));
    EXPECT_NEAR(got, exact, 1e-12 * exact) << h;
  }
}

TEST(FarPolygons, KeepTheirDigits) {
  const Polygon3 floor = rectangle(V(0), V(1, 0, 0), V(0, 1, 0));
  for (const double h : {1e3, 1e6, 1e9}) {
    // To the second order: F = A/(pi h^2) (1 - 2/3 (a/h)^2 ...) for unit squares face to face.
    const double first = 1.0 / (kPi * h * h);
    EXPECT_NEAR(exchangeArea_m2(floor, rectangle(V(0, 0, h), V(0, 1, 0), V(1, 0, 0))), first * (1.0 - 2.0 / (3.0 * h * h)), 1e-11 * first)
        << h;
  }
}

TEST(TouchingPolygons, GapsOfAnySizeAddUp) {
  // What leaves a square to one at a small gap, and to the four walls of the gap, is everything.
  const Polygon3 floor = rectangle(V(0), V(1, 0, 0), V(0, 1, 0));
  for (const double gap : {1e-2, 1e-5, 1e-8}) {
    const double across = exchangeArea_m2(floor, rectangle(V(0, 0, gap), V(0, 1, 0), V(1, 0, 0)));
    const double wall = exchangeArea_m2(floor, rectangle(V(0), V(0, 1, 0), V(0, 0, gap)));
    EXPECT_NEAR(across + 4.0 * wall, 1.0, 1e-13) << gap;
    EXPECT_NEAR(wall, 0.5 * gap, 0.03 * gap) << gap;
  }
}

TEST(Slivers, KeepTheirDigits) {
  // A sliver's factor goes to that of its middle line: F at the element, mean along the line.
  const Polygon3 square = rectangle(V(0, 0, 1), V(0, 1, 0), V(1, 0, 0));
  const auto& rule = gaussLegendre<double, 64>();
  for (const double w : {1e-4, 1e-6, 1e-8}) {
    double line = 0.0;
    for (std::size_t i = 0; i < 64; ++i) line += rule.weight[i] * elementToPolygon(V(rule.node[i], 0.5 * w, 0), V(0, 0, 1), square);
    EXPECT_NEAR(exchangeArea_m2(rectangle(V(0), V(1, 0, 0), V(0, w, 0)), square) / w, line, 0.02 * w * w + 1e-11) << w;
  }
}

TEST(HingedPolygons, AlmostFlatAndAlmostShut) {
  // Endless hinged strips of equal width: F = 1 - sin(a/2); a long edge comes near it, and reciprocity holds to the last digits.
  const double length = 1e4;
  for (const double degrees : {0.5, 90.0, 179.0}) {
    const double a = degrees * kPi / 180.0;
    const Polygon3 p = rectangle(V(0), V(1, 0, 0), V(0, length, 0));
    const Polygon3 q{V(0), V(0, length, 0), V(std::cos(a), length, std::sin(a)), V(std::cos(a), 0, std::sin(a))};
    const double f = exchangeArea_m2(p, q) / length, exact = 1.0 - std::sin(0.5 * a);
    EXPECT_NEAR(f, exact, 2e-4 * exact) << degrees;
    EXPECT_NEAR(exchangeArea_m2(q, p) / length, f, 1e-9 * f) << degrees;
  }
}

TEST(RoundDisc, IsTheSumOverItsPlaces) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> u(-1.0, 1.0);
  for (int k = 0; k < 30; ++k) {
    const V c(2.0 * u(random), 2.0 * u(random), 1.5 + u(random)), n = glm::normalize(V(u(random), u(random), 1.6));
    const double R = 0.8 + 0.4 * u(random);
    if (glm::dot(n, c) < R) continue;  // cut by the horizon: brute force has a kink
    const double exact = brute([&](double a, double b) {
      const double r = R * std::sqrt(a), phi = 2.0 * kPi * b;
      const V x = c + V(r * std::cos(phi), r * std::sin(phi), 0);
      return kPi * R * R * std::max(0.0, glm::dot(x, n)) * c.z / (kPi * std::pow(glm::dot(x, x), 2));
    });
    EXPECT_NEAR(elementToRoundDisc(V(0), n, c, V(0, 0, -1), R), exact, 1e-7 * exact);  // the root of a in brute force
  }
  for (const double h : {1e-7, 1e-3, 1.0, 1e7})
    EXPECT_NEAR(elementToRoundDisc(V(0), V(0, 0, 1), V(0, 0, h), V(0, 0, -1), 2.0), 4.0 / (4.0 + h * h), 1e-12 * 4.0 / (4.0 + h * h));
}

TEST(RoundDisc, HalfOfItBelowTheHorizon) {
  // Upright element before the middle of a disc: both halves of the horizon see the same.
  const double up = elementToRoundDisc(V(0), V(1, 0, 0), V(0, 0, 1e-2), V(0, 0, -1), 1.0),
               down = elementToRoundDisc(V(0), V(-1, 0, 0), V(0, 0, 1e-2), V(0, 0, -1), 1.0);
  EXPECT_NEAR(up, down, 1e-14);
  // A disc near: half of the hemisphere's projected half.
  EXPECT_NEAR(up, 0.5, 0.02);
}

TEST(Sphere, ClosedFormThroughTheHorizon) {
  // [howell B-42] in long double, where it still has digits.
  for (const double h : {1.001, 1.5, 4.0, 50.0})
    for (const double degrees : {60.0, 85.0, 89.0, 90.0, 95.0, 100.0}) {
      const long double a = (long double)(degrees)*kPi / 180.0L, x = std::sqrt((long double)(h)*h - 1.0L), c = std::cos(a), s = std::sin(a);
      const long double y = -x * c / s;
      long double exact = c / ((long double)(h)*h);
      if (y >= 1.0L) exact = 0.0L;
      if (c < 1.0L / h && y < 1.0L)
        exact = (c * std::acos(y) - x * s * std::sqrt(1.0L - y * y)) / ((long double)(kPi)*h * h) +
                std::atan(s * std::sqrt(1.0L - y * y) / x) / kPi;
      EXPECT_NEAR(elementToSphere(degrees * kPi / 180.0, h, 1.0), double(exact), 1e-14) << h << " " << degrees;
    }
  // Far and half below the horizon: 2/(3 pi) of (R/d)^3.
  EXPECT_NEAR(elementToSphere(V(0), V(0, 0, 1), V(1e6, 0, 0), 1.0) * 1e18, 2.0 / (3.0 * kPi), 1e-9);
}

TEST(Discs, OnOneAxisAtAnyDistance) {
  EXPECT_NEAR(1.0 - coaxialDiscs(1, 1, 1e-9), 1e-9, 1e-15);
  EXPECT_NEAR(coaxialDiscs(1, 1, 1e7) * 1e14, 1.0, 1e-12);
  EXPECT_NEAR(coaxialDiscs(3, 0.01, 2) * 9.0, coaxialDiscs(0.01, 3, 2) * 1e-4, 1e-16);
}

TEST(SolidAngle, IsThatOfACubesFaceAndKeepsItsDigitsFar) {
  EXPECT_NEAR(solidAngle_sr(V(0), rectangle(V(-1, -1, 1), V(0, 2, 0), V(2, 0, 0))), 4.0 * kPi / 6.0, 1e-15);
  EXPECT_NEAR(solidAngle_sr(V(0), rectangle(V(-1, -1, 1e6), V(0, 2, 0), V(2, 0, 0))), 4e-12 * (1.0 - 1e-12), 1e-24);
  EXPECT_EQ(solidAngle_sr(V(0), rectangle(V(-1, -1, 1), V(2, 0, 0), V(0, 2, 0))), 0.0) << "from behind";
}

TEST(SunBesideAnEdge, SharesAddUp) {
  for (const double k : {0.0, 0.1, 0.9, 0.9999, 1.0, 2.0}) EXPECT_NEAR(sunBesideEdge(0.3, k) + sunBesideEdge(0.3, -k), 1.0, 1e-15) << k;
  // A small sun is a flat disc: acos form of its segment.
  const double k = 0.4, flat = 1.0 - (std::acos(k) - k * std::sqrt(1.0 - k * k)) / kPi;
  EXPECT_NEAR(sunBesideEdge(1e-5, k), flat, 1e-10);
}

}  // namespace
}  // namespace lmc
