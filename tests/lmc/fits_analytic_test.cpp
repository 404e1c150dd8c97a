/// Curves through points that a formula made come out as that formula.
#include <gtest/gtest.h>

#include <cmath>

#include "libradiosity/lights.h"
#include "libscene/error.h"
#include "lmc/fit_attenuation.h"

namespace lmc {
namespace {

std::vector<FallOffPlace> placesOf(const ClassicAttenuation& a, int count = 200) {
  std::vector<FallOffPlace> out;
  for (int i = 0; i < count; ++i) {
    const double d = a.range * i / (count - 1);
    out.push_back({d, attenuation(a, d)});
  }
  return out;
}

TEST(FitAttenuation, KnownConstantsAreRecovered) {
  for (const ClassicAttenuation& known : {ClassicAttenuation{1.0, 0.2, 0.01, 10.0, 2.0}, ClassicAttenuation{0.5, 0.0, 3.0, 4.0, 4.0},
                                          ClassicAttenuation{2.0, 7.0, 0.0, 0.3, 1.5}, ClassicAttenuation{1.0, 0.0, 0.0, 100.0, 0.5},
                                          ClassicAttenuation{0.001, 0.02, 1.0, 25.0, 8.0}}) {
    const AttenuationFit fit = fitAttenuation(placesOf(known), known.range);
    // Residuals of an exact fit end at about the square root of Ceres' tolerance of the cost, 1e-15.
    EXPECT_LT(fit.rms, 1e-6) << known.constant << " " << known.linear << " " << known.quadratic << " " << known.power;
    EXPECT_LE(fit.rms, fit.largest);
    const double r = known.range, whole = known.constant + known.linear * r + known.quadratic * r * r;
    // What a constant does is its part of the denominator.
    EXPECT_NEAR(fit.attenuation.constant, known.constant, 1e-4 * whole);
    EXPECT_NEAR(fit.attenuation.linear * r, known.linear * r, 1e-4 * whole);
    EXPECT_NEAR(fit.attenuation.quadratic * r * r, known.quadratic * r * r, 1e-4 * whole);
    EXPECT_NEAR(fit.attenuation.power, known.power, 1e-3 * known.power);
  }
}

TEST(FitAttenuation, UnitOfLengthAndOfLightChangeNothingButTheConstants) {
  const auto fitOf = [](double metre, double light) {
    std::vector<FallOffPlace> places;
    for (int i = 1; i <= 100; ++i) places.push_back({0.05 * i * metre, light * std::exp(-0.05 * i)});
    return fitAttenuation(places, 5.0 * metre);
  };
  const AttenuationFit one = fitOf(1.0, 1.0), other = fitOf(1000.0, 40.0);
  // Both end within Ceres' tolerance of one minimum, where the error is flat.
  EXPECT_NEAR(other.rms, one.rms, 1e-6 * one.rms);
  EXPECT_NEAR(attenuation(other.attenuation, 2000.0), 40.0 * attenuation(one.attenuation, 2.0), 1e-3);
}

TEST(FitAttenuation, StatedErrorIsThatOfTheCurve) {
  const std::vector<FallOffPlace> places = fallOffPlaces({.range_m = 8.0, .fallOff = "inverse-square"});
  const AttenuationFit fit = fitAttenuation(places, 8.0);
  double mean = 0.0, squares = 0.0, largest = 0.0;
  for (const FallOffPlace& p : places) mean += p.value / double(places.size());
  for (const FallOffPlace& p : places) {
    const double off = std::abs(attenuation(fit.attenuation, p.distance_m) - p.value) / std::max(p.value, 0.01 * mean);
    squares += off * off / double(places.size());
    largest = std::max(largest, off);
  }
  EXPECT_NEAR(fit.rms, std::sqrt(squares), 1e-12);
  EXPECT_EQ(fit.largest, largest);
  // 1/d^2 does not end at the range, where the window is 0: nothing fits there, and nothing else is as wrong.
  EXPECT_NEAR(fit.largestAt_m, 8.0, 1e-9);
  EXPECT_LT(fit.rms, 0.12);
}

TEST(FitAttenuation, WindowedInverseSquareComesNear) {
  const AttenuationFit fit = fitAttenuation(fallOffPlaces({.range_m = 8.0, .fallOff = "inverse-square-window"}), 8.0);
  // 1/d^2 times KHR's window is the classic form with c = l = 0, q = 1, power 4.
  EXPECT_LT(fit.rms, 1e-4);
  EXPECT_NEAR(fit.attenuation.quadratic, 1.0, 1e-3);
  EXPECT_NEAR(fit.attenuation.power, 4.0, 1e-2);
}

TEST(FitAttenuation, UnknownFallOffIsAnErrorOfUsage) {
  try {
    fallOffPlaces({.range_m = 1.0, .fallOff = "no-such"});
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.kind, Exit::Usage);
  }
}

TEST(FitPowerLaw, FactorAndExponentAreRecovered) {
  std::vector<CurvePoint> points;
  for (const double x : {0.08, 0.04, 0.02, 0.01, 0.005}) points.push_back({x, 3.5 * std::pow(x, -1.3)});
  const auto law = fitPowerLaw(points);
  ASSERT_TRUE(law);
  EXPECT_NEAR(law->exponent, -1.3, 1e-9);
  EXPECT_NEAR(law->factor, 3.5, 1e-8);
  EXPECT_LT(law->rms, 1e-9);
}

TEST(FitPowerLaw, IsTheLineOfLeastSquaresInLogarithms) {
  // By hand: log2 x = 0 1 2, log2 y = 0 3 3: slope 1.5, middle (1, 2), residuals -0.5 1 -0.5.
  const std::vector<CurvePoint> points{{1, 1}, {2, 8}, {4, 8}};
  const auto law = fitPowerLaw(points);
  ASSERT_TRUE(law);
  EXPECT_NEAR(law->exponent, 1.5, 1e-9);
  EXPECT_NEAR(law->factor, std::exp2(0.5), 1e-9);
  EXPECT_NEAR(law->rms, std::log(2.0) * std::sqrt(0.5), 1e-12);        // sqrt((0.25 + 1 + 0.25)/3)
  EXPECT_NEAR(law->exponentError, std::sqrt(1.5 / 1.0 / 2.0), 1e-12);  // sum of squares 1.5, one degree of freedom, spread 2
}

TEST(FitPowerLaw, NothingComesOfPointsWithoutALine) {
  EXPECT_FALSE(fitPowerLaw(std::vector<CurvePoint>{{1, 1}}));
  EXPECT_FALSE(fitPowerLaw(std::vector<CurvePoint>{{2, 1}, {2, 3}}));
  EXPECT_FALSE(fitPowerLaw(std::vector<CurvePoint>{{0, 1}, {2, 3}, {-1, 1}}));
}

}  // namespace
}  // namespace lmc
