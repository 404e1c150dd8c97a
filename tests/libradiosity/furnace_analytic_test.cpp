/// White rooms and other enclosures with a closed form, through the solvers and through the whole pipeline.
#include <gtest/gtest.h>

#include "libscene/constants.h"
#include "tests/support/bake_scene.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

using test::bakeScene;
using test::furnace;

class Furnace : public testing::TestWithParam<std::tuple<float, Solver>> {};

TEST_P(Furnace, IlluminanceIsTheClosedForm) {
  const auto [rho, solver] = GetParam();
  const double exact = kPi / (1.0 - double(rho));
  const test::Baked b = bakeScene(furnace(rho, 1.0f), {.side = 64, .goal = 0.02, .patchSize_m = 0.7, .solver = solver});
  for (std::uint32_t face = 0; face < 6; ++face) EXPECT_NEAR(b.mean(face).x, exact, 0.01 * exact) << "face " << face;
  EXPECT_LT(b.solution.energy.imbalance(), 0.005);
}

INSTANTIATE_TEST_SUITE_P(Albedo, Furnace,
                         testing::Combine(testing::Values(0.1f, 0.5f, 0.9f, 0.99f),
                                          testing::Values(Solver::Dense, Solver::Stored, Solver::Shooting)),
                         [](const auto& i) {
                           const Solver solver = std::get<1>(i.param);
                           return std::string(solver == Solver::Dense    ? "Dense"
                                              : solver == Solver::Stored ? "Stored"
                                                                         : "Shooting") +
                                  std::to_string(int(100.0f * std::get<0>(i.param) + 0.5f));
                         });

TEST(DenseSolver, FewIterationsAtAnyAlbedo) {
  for (const float rho : {0.5f, 0.95f, 0.999f}) {
    const test::Baked b = bakeScene(furnace(rho, 1.0f), {.side = 32, .patchSize_m = 1.0, .solver = Solver::Dense});
    EXPECT_LE(b.solution.passes, 12) << rho;
    EXPECT_EQ(b.solution.stop, Stop::Energy);
    EXPECT_NEAR(b.solution.illuminance[0].x, rho * kPi / (1.0f - rho), 2e-3 * rho * kPi / (1.0f - rho))
        << rho;  // E less its direct part pi
  }
}

TEST(FormFactors, RowsSumToOneInAClosedRoomAndAreReciprocal) {
  const Scene scene = furnace(0.5f, 1.0f);
  const lmc::Run run;
  const Tracer tracer(scene);
  const PatchMesh mesh = makePatches(scene, {.size_m = 0.8}, run);
  const FormFactors f = computeFormFactors(scene, tracer, mesh, run);
  EXPECT_LT(f.closureError, 2e-3);  // the ladder's own error, before rows are scaled
  for (std::size_t i = 0; i < f.size; ++i) {
    double row = 0.0;
    for (std::size_t j = 0; j < f.size; ++j) {
      row += f.at(i, j);
      EXPECT_EQ(f.at(i, j), f.at(j, i));
    }
    EXPECT_NEAR(row / mesh.patches[i].area_m2, 1.0, 1e-6);  // float storage of a few hundred entries
  }
}

TEST(Shooting, OnePassIsOneBounce) {
  const Scene scene = furnace(0.5f, 1.0f);
  const lmc::Run run;
  const Tracer tracer(scene);
  PatchMesh mesh = makePatches(scene, {.size_m = 0.8}, run);
  exposePatches(mesh, scene, tracer, run);
  const DirectLight direct(scene, tracer, true);
  const PatchLight light = lightPatches(scene, tracer, mesh, direct, {}, run);
  // Direct light is pi everywhere, so k bounces give pi (rho + ... + rho^k).
  for (int k = 1; k <= 3; ++k) {
    int pictures = 0;
    ShootOptions options;
    options.maxPasses = k;
    options.onPass = [&](int, const Bounced&) { ++pictures; };
    const Solution s = shoot(scene, tracer, mesh, light, options, run);
    EXPECT_EQ(s.passes, k);
    EXPECT_EQ(s.stop, Stop::Passes);
    EXPECT_EQ(pictures, k);
    double mean = 0.0, area = 0.0, missing = 0.0;
    for (std::size_t i = 0; i < mesh.patches.size(); ++i) {
      mean += mesh.patches[i].area_m2 * double(s.illuminance[i].x);
      area += mesh.patches[i].area_m2;
    }
    mean /= area;
    double exact = 0.0;
    for (int m = 1; m <= k; ++m) exact += kPi * std::pow(0.5, m);
    // Exitance: rho pi (1 + ... + rho^k) of 2 rho pi is there.
    const double there = 1.0 - std::pow(0.5, k + 1);
    missing = (1.0 - there) / there;
    EXPECT_NEAR(mean, exact, 2e-3 * exact);  // energy is exact; 64 places of direct light are not
    EXPECT_GE(s.tail, missing * 0.99) << "the printed bound holds what was left out";
    EXPECT_NEAR(s.tailEstimate, missing, 0.02 * missing) << "passes of a furnace fall by rho";
  }
}

}  // namespace
}  // namespace lmc
