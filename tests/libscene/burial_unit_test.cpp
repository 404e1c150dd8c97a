/// How places lie among solids.

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "libscene/burial.h"
#include "libscene/rng.h"
#include "libscene/sampling.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

/// Of the origin, on a floor below a box of half a metre without a bottom.
Lie underABox(bool doubleSided, float fromOrigin_m, bool inRoom) {
  test::SceneBuilder b(4);
  const std::uint32_t plain = b.material(Rgb(0.5f)), box = b.material(Rgb(0.5f));
  b.scene.materials[box].doubleSided = doubleSided;
  b.quad({-2, 0, -2}, {0, 0, 4}, {4, 0, 0}, plain);
  const auto boxOf = [&](glm::vec3 lo, glm::vec3 size, std::uint32_t material, bool outwards) {
    const glm::vec3 X(size.x, 0, 0), Y(0, size.y, 0), Z(0, 0, size.z);
    const auto side = [&](glm::vec3 at, glm::vec3 u, glm::vec3 v) { outwards ? b.quad(at, u, v, material) : b.quad(at, v, u, material); };
    side(lo, Z, Y);
    side(lo + X, Y, Z);
    side(lo, Y, X);
    side(lo + Z, X, Y);
    side(lo + Y, Z, X);
  };
  boxOf({fromOrigin_m - 0.25f, 0, -0.25f}, {0.5f, 0.5f, 0.5f}, box, true);
  if (inRoom) boxOf({-2, 0, -2}, {4, 4, 4}, plain, false);
  const Tracer tracer(b.scene);
  std::array<Ray, kLieRays> rays;
  const Sobol4 numbers(1);
  for (std::uint32_t k = 0; k < kLieRays; ++k) {
    const glm::dvec3 d = frameAbout({0, 1, 0}) * cosineHemisphere(numbers.point2(k));
    rays[k] = {tracer.lifted({0.01, 0.0, 0.02}, {0, 1, 0}), glm::vec3(d), INFINITY};
  }
  return lieOf(tracer, rays, Purpose::Exposure);
}

TEST(Burial, APlaceUnderABoxIsBuriedAndOneBesideItIsNot) {
  for (const bool inRoom : {false, true}) {
    EXPECT_EQ(underABox(false, 0.0f, inRoom), Lie::Buried);
    EXPECT_EQ(underABox(false, 0.6f, inRoom), inRoom ? Lie::Closed : Lie::Free);
  }
}

TEST(Burial, ATentOfDoubleSidedFacesIsARoom) { EXPECT_EQ(underABox(true, 0.0f, false), Lie::Closed); }

}  // namespace
}  // namespace lmc
