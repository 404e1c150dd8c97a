#include "libradiosity/seam_solve.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lmc {
namespace {

/// x0 - x1 is to vanish.
SeamSystem pair(double strength) {
  SeamSystem s{{1.0, 2.0}, {0.1, 0.2}, {10.0, 10.0}, {}};
  SeamEquation e;
  e.unknown = {0, 1};
  e.weight = {1.0, -1.0};
  e.count = 2;
  e.strength = strength;
  s.equations.push_back(e);
  return s;
}

TEST(SeamSolve, TwoTexelsMeetWhereTheirErrorsPutThem) {
  // Minimum of (a/0.1)^2 + (b/0.2)^2 + k^2 (d - a - b)^2 with d = 1: moves in proportion to variances, a + b = d V/(V + 1/k^2), V = 0.05.
  for (const double k : {1.0, 10.0, 1000.0}) {
    const std::vector<double> x = solveSeams(pair(k));
    const double moved = 0.05 / (0.05 + 1.0 / (k * k));
    EXPECT_NEAR(x[0], 1.0 + 0.2 * moved, 1e-9) << k;
    EXPECT_NEAR(x[1], 2.0 - 0.8 * moved, 1e-9) << k;
  }
}

TEST(SeamSolve, WhatReachesItsLimitStaysThereAndTheOtherGoesOn) {
  SeamSystem s = pair(1000.0);
  s.limit = {10.0, 0.3};
  const std::vector<double> x = solveSeams(s);
  EXPECT_DOUBLE_EQ(x[1], 1.7);
  EXPECT_NEAR(x[0], 1.7, 1e-4);
  s.limit = {0.1, 0.3};
  const std::vector<double> both = solveSeams(s);
  EXPECT_DOUBLE_EQ(both[0], 1.1);
  EXPECT_DOUBLE_EQ(both[1], 1.7);
}

TEST(SeamSolve, ValuesThatMeetStayToTheBit) {
  SeamSystem s = pair(10.0);
  s.value = {0.7, 0.7};
  EXPECT_EQ(solveSeams(s), s.value);
  EXPECT_TRUE(solveSeams({}).empty());
}

TEST(SeamSolve, LongRowsAreSolvedExactly) {
  // A chain x0 = x1 = ... with ends 0 and 1, as strong as the pull to the values: (1 + 2 k^2) x_i - k^2 (x_(i-1) + x_(i+1)) = v_i inside.
  constexpr std::uint32_t n = 5000;
  SeamSystem s{std::vector<double>(n, 0.5), std::vector<double>(n, 1.0), std::vector<double>(n, 10.0), {}};
  s.value.front() = 0.0;
  s.value.back() = 1.0;
  for (std::uint32_t i = 0; i + 1 < n; ++i) {
    SeamEquation e;
    e.unknown = {i, i + 1};
    e.weight = {1.0, -1.0};
    e.count = 2;
    e.strength = 3.0;
    s.equations.push_back(e);
  }
  const std::vector<double> x = solveSeams(s);
  for (std::uint32_t i = 1; i + 1 < n; ++i) ASSERT_NEAR(19.0 * x[i] - 9.0 * (x[i - 1] + x[i + 1]), s.value[i], 1e-9) << i;
  ASSERT_NEAR(10.0 * x[0] - 9.0 * x[1], 0.0, 1e-9);
}

}  // namespace
}  // namespace lmc
