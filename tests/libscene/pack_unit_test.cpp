#include "libscene/pack.h"

#include <gtest/gtest.h>

#include <random>

namespace lmc {
namespace {

TexelMask rectangle(int width, int height) {
  TexelMask m(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) m.set(x, y);
  return m;
}

/// Texels of a mask that lies as the placement says.
std::vector<glm::ivec2> texelsOf(const TexelMask& mask, const Placement& p) {
  std::vector<glm::ivec2> out;
  for (int y = 0; y < mask.height(); ++y)
    for (int x = 0; x < mask.width(); ++x)
      if (mask.at(x, y)) out.push_back(glm::ivec2(glm::floor(placed(p, {x + 0.5, y + 0.5}, mask.width(), mask.height()))));
  return out;
}

TEST(TexelMask, HoldsTheTexelsThatATriangleTouches) {
  const std::array<glm::dvec2, 3> t{{{0.0, 0.0}, {2.5, 0.0}, {0.0, 2.5}}};
  const TexelMask m(std::vector{t});
  ASSERT_EQ(m.width(), 3);
  ASSERT_EQ(m.height(), 3);
  // The long side runs through (2.5, 0), (1.5, 1), (0.5, 2).
  const bool want[3][3] = {{true, true, true}, {true, true, false}, {true, false, false}};
  for (int y = 0; y < 3; ++y)
    for (int x = 0; x < 3; ++x) EXPECT_EQ(m.at(x, y), want[y][x]) << x << ' ' << y;
}

TEST(TexelMask, EdgesOnTheGridTouchOneSideOnly) {
  const TexelMask m(std::vector<std::array<glm::dvec2, 3>>{{{{0, 0}, {4, 0}, {4, 2}}}, {{{0, 0}, {4, 2}, {0, 2}}}});
  EXPECT_EQ(m.width(), 4);
  EXPECT_EQ(m.height(), 2);
  EXPECT_EQ(m.count(), 8u);
}

TEST(Packer, EqualSquaresFillTheStrip) {
  Packer packer(32);
  for (int i = 0; i < 16; ++i) EXPECT_GE(packer.add(rectangle(8, 8), 32, 0).x, 0);
  EXPECT_EQ(packer.height(), 32);
  EXPECT_LT(packer.add(rectangle(1, 1), 32, 0).x, 0);
}

TEST(Packer, ALyingBarFitsAStandingGap) {
  Packer packer(10);
  packer.add(rectangle(8, 12), 12, 0);
  const Placement p = packer.add(rectangle(12, 2), 12, 0);
  EXPECT_EQ(p.x, 8);
  EXPECT_EQ(p.quarters % 2, 1);
}

TEST(Packer, ShapesFillTheHolesOfOthers) {
  TexelMask frame = rectangle(10, 10);
  TexelMask hollow(10, 10);
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 10; ++x)
      if (x == 0 || y == 0 || x == 9 || y == 9) hollow.set(x, y);
  Packer packer(10);
  packer.add(hollow, 100, 1);
  EXPECT_LE(packer.add(rectangle(6, 6), 100, 1).y, 2);
  EXPECT_EQ(packer.height(), 10);
}

TEST(Packer, WhatIsBlockedStaysFree) {
  TexelMask taken(16, 16);
  taken.set(5, 0);
  Packer packer(16);
  packer.block(taken, 0, 2);
  const Placement p = packer.add(rectangle(4, 4), 16, 2);
  EXPECT_TRUE(p.x >= 8 || p.y >= 3) << p.x << ' ' << p.y;
}

/// Shapes of any outline: none comes nearer to another than its padding, whatever turn it took.
TEST(Packer, RandomShapesKeepTheirDistance) {
  std::mt19937 random(7);
  const auto upTo = [&](int n) { return int(random() % unsigned(n)); };
  for (int round = 0; round < 20; ++round) {
    const int width = 20 + upTo(120), padding = upTo(4);
    Packer packer(width);
    std::vector<std::vector<int>> owner(2000, std::vector<int>(std::size_t(width), -1));
    for (int i = 0; i < 40; ++i) {
      TexelMask m(1 + upTo(18), 1 + upTo(18));
      for (int y = 0; y < m.height(); ++y)
        for (int x = 0; x < m.width(); ++x)
          if (upTo(3) > 0) m.set(x, y);
      m.set(0, 0);
      const Placement p = packer.add(m, 2000, padding);
      ASSERT_GE(p.x, 0);
      for (const glm::ivec2 t : texelsOf(m, p)) {
        ASSERT_TRUE(t.x >= 0 && t.x < width && t.y >= 0 && t.y < packer.height());
        for (int y = std::max(0, t.y - padding); y <= t.y + padding; ++y)
          for (int x = std::max(0, t.x - padding); x <= std::min(width - 1, t.x + padding); ++x)
            ASSERT_TRUE(owner[std::size_t(y)][std::size_t(x)] == -1 || owner[std::size_t(y)][std::size_t(x)] == i) << round << ' ' << i;
      }
      for (const glm::ivec2 t : texelsOf(m, p)) owner[std::size_t(t.y)][std::size_t(t.x)] = i;
    }
  }
}

}  // namespace
}  // namespace lmc
