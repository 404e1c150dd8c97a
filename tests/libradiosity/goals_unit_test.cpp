/// What a goal asks for: hemisphere rays by count, and what is stated for them.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/bake_scene.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

std::uint64_t hemisphereRays(const test::Baked& b) {
  std::uint64_t sum = 0;
  for (const std::uint32_t n : b.map.rays) sum += n;
  return sum;
}

TEST(Goals, WhatTheFirstRaysMeetTakesNoOthers) {
  // A furnace is as bright everywhere: no ray differs from another, and 8 a half tell.
  const test::Baked b = bakeScene(test::furnace(0.5f, 1.0f), {.goal = 0.02, .solver = Solver::Stored});
  EXPECT_EQ(*std::ranges::max_element(b.map.rays), 8u);
  EXPECT_LT(b.ledger.bound95, 0.02);
}

TEST(Goals, EachCastsMoreRaysThanTheCoarserAndStatesLess) {
  const Scene scene = test::litRoom();
  std::uint64_t rays = 0;
  double bound = 1.0;
  for (const double goal : {0.16, 0.08, 0.04, 0.02, 0.01}) {
    const test::Baked b = bakeScene(scene, {.goal = goal, .solver = Solver::Stored});
    EXPECT_GT(hemisphereRays(b), rays) << goal;
    EXPECT_LT(b.ledger.bound95, bound) << goal;
    EXPECT_LT(b.ledger.bound95, goal) << goal;
    rays = hemisphereRays(b);
    bound = b.ledger.bound95;
  }
}

}  // namespace
}  // namespace lmc
