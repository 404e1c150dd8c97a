/// Skies, zonal systems, endless enclosures, narrow spots and visible shares against closed forms.
#include <gtest/gtest.h>

#include <cmath>

#include "libradiosity/endless.h"
#include "libradiosity/form_factor_bodies.h"
#include "libradiosity/lights.h"
#include "libradiosity/occlusion.h"
#include "libradiosity/skies.h"
#include "libradiosity/zonal.h"
#include "libscene/constants.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

using V = glm::dvec3;

TEST(Sky, HorizontalAndUpsideDown) {
  EXPECT_NEAR(skyIlluminance(SkyKind::Uniform, 0.0), kPi, 1e-14);
  EXPECT_NEAR(skyIlluminance(SkyKind::MoonSpencer, 0.0), 7.0 * kPi / 9.0, 1e-12);
  EXPECT_NEAR(skyIlluminance(SkyKind::CieOvercast, kPi), 0.0, 1e-15);
  EXPECT_EQ(skyRadiance(SkyKind::MoonSpencer, -0.1), 0.0);
}

TEST(Sky, ThroughAPolygonIsTheFormFactorWhenUniform) {
  const Polygon3 opening{V(-1, 2, 1e-3), V(3, 2, 1e-3), V(3, -1, 1e-3), V(-1, -1, 1e-3)};  // near and wide
  const V n = glm::normalize(V(0.3, 0.2, 1));
  EXPECT_NEAR(skyThroughPolygon(SkyKind::Uniform, V(0), n, opening, V(0, 0, 1)), kPi * elementToPolygon(V(0), n, opening), 1e-11);
}

TEST(Zonal, ThinBoxClosesAndAWhiteOneKeepsItsLight) {
  for (const double c : {1.0, 1e-3, 1e-6}) {
    const auto f = boxFactors(2.0, 3.0, c);
    for (std::size_t i = 0; i < 6; ++i) {
      long double row = 0.0L;
      for (std::size_t j = 0; j < 6; ++j) row += f[i * 6 + j];
      EXPECT_NEAR(double(row), 1.0, 1e-12) << c << " face " << i;
    }
  }
  const std::vector<long double> emission(6, 1.0L), albedo(6, 0.9999L);
  EXPECT_NEAR(double(solveZonal(boxFactors(1, 1, 1), emission, albedo).radiosity[3]), 1e4, 1e-8);
}

TEST(Zonal, SeriesTerms) {
  EXPECT_EQ(seriesTerms(0.0L, 1e-3L), 1.0);
  EXPECT_EQ(seriesTerms(0.1L, 1e-3L), 3.0) << "the quotient of logarithms is whole";
  EXPECT_EQ(seriesTerms(0.999L, 1e-3L), 6905.0);
}

TEST(Endless, TubeOfLikeSidesIsAFurnaceAndABlackCornerIsHottels) {
  const std::vector<Strip> tube{
      {{0, 0}, {1, 0}, 1, 0.999}, {{1, 0}, {1, 1}, 1, 0.999}, {{1, 1}, {0, 1}, 1, 0.999}, {{0, 1}, {0, 0}, 1, 0.999}};
  const EndlessEnclosure e(tube, 32);
  EXPECT_NEAR(e.mean(2), 1000.0, 1e-7);
  EXPECT_NEAR(e.at(1, 0.01), 1000.0, 1e-7);
  const std::vector<Strip> corner{{{0, 0}, {2, 0}, 1, 0}, {{0, 1}, {0, 0}, 0, 0}};
  EXPECT_NEAR(EndlessEnclosure(corner, 16).mean(1), (2.0 + 1.0 - std::sqrt(5.0)) / 2.0, 1e-13);
}

TEST(Spot, NarrowConesKeepTheirDigits) {
  EXPECT_NEAR(spotConeByAngle(0.4, 0.3, 0.9), spotCone(std::cos(0.4), std::cos(0.3), std::cos(0.9)), 1e-14);
  // A cone of 1e-3 rad: cosines differ by 5e-7, the ramp of 0.001 is never climbed: flux = 2 pi x^3/(3 w^2).
  const double x = 2.0 * std::pow(std::sin(5e-4), 2);
  EXPECT_NEAR(spotFlux_lm(0.0, 1e-3) / (2.0 * kPi * x * x * x / 3e-6), 1.0, 1e-12);
}

TEST(VisibleShare, HalfIsHiddenByAHalfPlane) {
  test::SceneBuilder b;
  const Polygon3 floor{V(-1, -1, 0), V(1, -1, 0), V(1, 1, 0), V(-1, 1, 0)}, ceiling{V(-1, 1, 2), V(1, 1, 2), V(1, -1, 2), V(-1, -1, 2)};
  const Polygon3 shade{V(0, -5, 1), V(5, -5, 1), V(5, 5, 1), V(0, 5, 1)};
  b.polygon(shade, b.material(Rgb(0.0f)));
  const Tracer tracer(b.scene);
  const PolygonSampler from(floor), to(ceiling);
  double mean = 0.0;
  for (std::uint32_t k = 0; k < 8; ++k) mean += visibleShare(tracer, from, to, sequence(1, Draw::Visibility, 0, 0, 0, 0, k), 8192) / 8.0;
  EXPECT_NEAR(mean, 0.5, 2e-3);  // 65536 pairs at random would err by 2e-3
  EXPECT_EQ(visibleShareBeyond(tracer, V(2, 0, 0), V(0, 0, 1), PolygonSampler(Polygon3{V(2, 1, 2), V(3, 1, 2), V(3, 0, 2), V(2, 0, 2)}),
                               Sobol4(3), 256),
            0.0);
}

}  // namespace
}  // namespace lmc
