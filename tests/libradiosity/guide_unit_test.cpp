/// The guide sends rays elsewhere and must change no mean.
#include "libradiosity/guide.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <vector>

#include "libscene/rng.h"

namespace lmc {
namespace {

using Light = std::function<float(glm::vec2)>;

/// A guide that so many rays have taught.
Guide taught(const Light& light, std::uint32_t rays = 4096) {
  Guide g;
  const Sobol4 numbers(5);
  for (std::uint32_t k = 0; k < rays; ++k) {
    const glm::vec2 u = numbers.point2(k);
    g.add(u, light(u), 1.0f);
  }
  g.count(rays);
  g.build();
  return g;
}

float window(glm::vec2 u) { return u.x > 0.62f && u.x < 0.71f && u.y > 0.13f && u.y < 0.3f ? 50.0f : 0.05f; }

constexpr int kGrid =
    4096;  // u of a midpoint grid: each cell of the histogram gets at least 0.3/16 of it along x and along y, 76 midpoints
glm::vec2 midpoint(int x, int y) { return (glm::vec2(float(x), float(y)) + 0.5f) / float(kGrid); }

TEST(Guide, WeightIsTheReciprocalDensity) {
  const Guide g = taught(window);
  std::vector<double> count(Guide::kSide * Guide::kSide, 0.0), weightOf(count.size(), 0.0);
  double sum = 0.0;
  float most = 0.0f, least = 1e9f;
  for (int y = 0; y < kGrid; ++y)
    for (int x = 0; x < kGrid; ++x) {
      float weight = 0.0f;
      const glm::vec2 w = g.warp(midpoint(x, y), weight);
      ASSERT_TRUE(w.x >= 0.0f && w.x < 1.0f && w.y >= 0.0f && w.y < 1.0f);
      const auto cell = std::size_t(int(w.y * Guide::kSide) * Guide::kSide + int(w.x * Guide::kSide));
      count[cell] += 1.0;
      weightOf[cell] = double(weight);
      sum += double(weight);
      most = std::max(most, weight);
      least = std::min(least, weight);
    }
  const double all = double(kGrid) * kGrid;
  // A cell is a column's part and a row's part of that: a midpoint more or less of each.
  constexpr auto kSide = std::size_t(Guide::kSide);
  for (std::size_t x = 0; x < kSide; ++x) {
    double column = 0.0;
    for (std::size_t y = 0; y < kSide; ++y) column += count[y * kSide + x];
    for (std::size_t y = 0; y < kSide; ++y) {
      const double cell = count[y * kSide + x];
      const double tolerance = double(kGrid) / column + column / (cell * double(kGrid));
      EXPECT_NEAR(cell / all * weightOf[y * kSide + x] * double(count.size()), 1.0, tolerance) << x << " " << y;
    }
  }
  EXPECT_NEAR(sum / all, 1.0, 1e-3);
  EXPECT_LE(most, 1.0f / Guide::kBlind * 1.0001f);
  EXPECT_LT(least, 0.2f) << "it went where the light is";
}

TEST(Guide, IntegralsOfStepsStayTheSame) {
  const Guide g = taught(window);
  // Steps that lie on no border of the histogram.
  const Light f = [](glm::vec2 u) { return u.x + 0.4f * u.y < 0.517f ? 3.0f : u.y > 0.271f ? 0.7f : u.x > 0.643f ? 40.0f : 0.0f; };
  double plain = 0.0, guided = 0.0;
  for (int y = 0; y < kGrid; ++y)
    for (int x = 0; x < kGrid; ++x) {
      const glm::vec2 u = midpoint(x, y);
      float weight = 0.0f;
      const glm::vec2 w = g.warp(u, weight);
      plain += double(f(u));
      guided += double(weight) * double(f(w));
    }
  // Steps of at most 40, weights of at most 3.3, and a midpoint's width of 1/4096 along an edge of about 1: below 0.03 of about 5.
  EXPECT_NEAR(guided / plain, 1.0, 5e-3);
}

TEST(Guide, EvenLightLeavesSamplesAsTheyAre) {
  const Guide even = taught([](glm::vec2) { return 2.0f; }), dark = taught([](glm::vec2) { return 0.0f; }), fresh;
  for (const Guide* g : {&even, &dark, &fresh}) {
    const Sobol4 numbers(8);
    for (std::uint32_t k = 0; k < 1000; ++k) {
      const glm::vec2 u = numbers.point2(k);
      float weight = 0.0f;
      EXPECT_EQ(g->warp(u, weight), u);
      EXPECT_EQ(weight, 1.0f);
    }
  }
}

TEST(Guide, LearnsFromItsOwnRays) {
  // Weighted rays of a built guide teach it the same light: variance after a second round is no worse.
  Guide g = taught(window, 1024);
  const auto secondMoment = [](const Guide& guide) {
    const Sobol4 numbers(21);
    double sum = 0.0;
    for (std::uint32_t k = 0; k < 65536; ++k) {
      float weight = 0.0f;
      const glm::vec2 w = guide.warp(numbers.point2(k), weight);
      sum += double(weight * window(w)) * double(weight * window(w)) / 65536.0;
    }
    return sum;
  };
  const double once = secondMoment(g), blind = secondMoment(Guide());
  const Sobol4 numbers(22);
  for (std::uint32_t k = 0; k < 4096; ++k) {
    float weight = 0.0f;
    const glm::vec2 w = g.warp(numbers.point2(k), weight);
    g.add(w, window(w), weight);
  }
  g.count(4096);
  g.build();
  EXPECT_LT(once, 0.5 * blind);
  EXPECT_LT(secondMoment(g), 1.1 * once);
}

}  // namespace
}  // namespace lmc
