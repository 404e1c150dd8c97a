#include "libscene/rng.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

namespace lmc {
namespace {

TEST(Sobol, EveryElementaryIntervalHoldsOnePoint) {
  // The first two coordinates are a (0, 2)-net: 2^k points put exactly one into each box of 2^-i by 2^-(k-i), scrambled or not.
  for (std::uint32_t key = 0; key < 20; ++key) {
    const Sobol4 s = sequence(key, Draw::Direct, 0, 0, 3, 4, 0);
    for (int i = 0; i <= 6; ++i) {
      std::set<std::pair<int, int>> boxes;
      for (std::uint32_t k = 0; k < 64; ++k) {
        const glm::vec4 p = s.point(k);
        boxes.emplace(int(p.x * float(1 << i)), int(p.y * float(64 >> i)));
      }
      EXPECT_EQ(boxes.size(), 64u) << "key " << key << ", split " << i;
    }
  }
}

TEST(Sobol, EachCoordinateIsStratified) {
  const Sobol4 s = sequence(9, Draw::Hemisphere, 0, 0, 1, 2, 1);
  for (int c = 0; c < 4; ++c) {
    std::set<int> cells;
    for (std::uint32_t k = 0; k < 256; ++k) {
      const float v = s.point(k)[c];
      EXPECT_GE(v, 0.0f);
      EXPECT_LT(v, 1.0f);
      cells.insert(int(v * 256.0f));
    }
    EXPECT_EQ(cells.size(), 256u);
  }
}

TEST(Sobol, ScramblesAreIndependentAndUnbiased) {
  // Mean of x y over many scrambles is 1/4 within 4 standard errors; so is that of products across halves.
  double sum = 0.0, sum2 = 0.0, cross = 0.0;
  constexpr int kScrambles = 4000;
  for (std::uint32_t i = 0; i < kScrambles; ++i) {
    const glm::vec4 a = sequence(1, Draw::Direct, 0, 0, i, 0, 0).point(5), b = sequence(1, Draw::Direct, 0, 0, i, 0, 1).point(5);
    sum += a.x * a.y;
    sum2 += double(a.x * a.y) * double(a.x * a.y);
    cross += (a.x - 0.5) * (b.x - 0.5);
  }
  const double mean = sum / kScrambles, error = std::sqrt((sum2 / kScrambles - mean * mean) / kScrambles);
  EXPECT_NEAR(mean, 0.25, 4.0 * error);
  EXPECT_NEAR(cross / kScrambles, 0.0, 4.0 / 12.0 / std::sqrt(double(kScrambles)));  // variance of a uniform number is 1/12
}

TEST(Sobol, SixteenTimesThePointsDivideTheErrorByMuchMoreThanFour) {
  const auto error = [](std::uint32_t n) {
    double sum2 = 0.0;
    for (std::uint32_t key = 0; key < 200; ++key) {
      const Sobol4 s = sequence(1, Draw::Direct, 7, 0, key, 0, 0);
      double mean = 0.0;
      for (std::uint32_t k = 0; k < n; ++k) mean += s.point2(k).x * s.point2(k).y / n;
      sum2 += (mean - 0.25) * (mean - 0.25);
    }
    return std::sqrt(sum2 / 200.0);
  };
  EXPECT_GT(error(16) / error(256), 20.0);  // smooth integrand: n^-1.5 would be 64, random numbers give 4
}

TEST(Address, EveryPartOfItMatters) {
  std::set<float> seen;
  seen.insert(sequence(1, Draw::Direct, 0, 0, 0, 0, 0).point(0).x);
  seen.insert(sequence(2, Draw::Direct, 0, 0, 0, 0, 0).point(0).x);
  seen.insert(sequence(1, Draw::Hemisphere, 0, 0, 0, 0, 0).point(0).x);
  seen.insert(sequence(1, Draw::Direct, hashName("/lamp"), 0, 0, 0, 0).point(0).x);
  seen.insert(sequence(1, Draw::Direct, 0, 1, 0, 0, 0).point(0).x);
  seen.insert(sequence(1, Draw::Direct, 0, 0, 1, 0, 0).point(0).x);
  seen.insert(sequence(1, Draw::Direct, 0, 0, 0, 1, 0).point(0).x);
  seen.insert(sequence(1, Draw::Direct, 0, 0, 0, 0, 1).point(0).x);
  EXPECT_EQ(seen.size(), 8u);
}

}  // namespace
}  // namespace lmc
