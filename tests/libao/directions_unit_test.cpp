#include "libao/directions.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lmc::ao {
namespace {

/// Mean of f(z, weight of the cosine, of the uniform) over a set.
template <class F>
double meanOf(std::uint32_t set, const F& f) {
  double sum = 0.0;
  for (std::uint32_t b = 0; b < kRaysOfSet / kBlock; ++b) {
    const Directions& d = directions(set, b);
    for (std::size_t i = 0; i < kBlock; ++i) sum += f(double(d.towards[i].z), double(d.cosine[i]), double(d.uniform[i]));
  }
  return sum / kRaysOfSet;
}

TEST(Directions, AreUnitAndAbove) {
  for (std::uint32_t b = 0; b < kRaysOfSet / kBlock; ++b) {
    const Directions& d = directions(7, b);
    for (std::size_t i = 0; i < kBlock; ++i) {
      EXPECT_GE(d.towards[i].z, 0.0f);
      EXPECT_NEAR(glm::length(d.towards[i]), 1.0f, 1e-6f);
    }
  }
}

// 4096 scrambled Sobol points, one in each stratum of z: errors of smooth integrands are near 4096^-1.5 = 4e-6; five times that is allowed.
TEST(Directions, ServeBothWeightings) {
  for (const std::uint32_t set : {0u, 13u, 63u}) {
    EXPECT_NEAR(meanOf(set, [](double, double c, double) { return c; }), 1.0, 2e-5);
    EXPECT_NEAR(meanOf(set, [](double, double, double u) { return u; }), 1.0, 2e-5);
    EXPECT_NEAR(meanOf(set, [](double z, double c, double) { return c * z; }), 2.0 / 3.0, 2e-5) << "integral of z 2 z";
    EXPECT_NEAR(meanOf(set, [](double z, double, double u) { return u * z; }), 0.5, 2e-5) << "integral of z";
    EXPECT_NEAR(meanOf(set, [](double, double c, double) { return c * c; }), std::log(3.0), 2e-5);
    EXPECT_NEAR(meanOf(set, [](double, double, double u) { return u * u; }), std::log(3.0), 2e-5);
  }
}

TEST(Directions, OfDifferentSetsDiffer) {
  int same = 0;
  for (std::size_t i = 0; i < kBlock; ++i) same += directions(0, 0).towards[i] == directions(1, 0).towards[i];
  EXPECT_EQ(same, 0);
}

}  // namespace
}  // namespace lmc::ao
