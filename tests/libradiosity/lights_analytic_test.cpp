/// Punctual lights against their formulas, traps included.
#include "libradiosity/lights.h"

#include <gtest/gtest.h>

#include <cmath>

#include "libscene/constants.h"

namespace lmc {
namespace {

TEST(Attenuation, RangeRuleEqualsItsClosedForm) {
  // c = 1, l = 2/r, q = 1/r^2 (the product, not 1/r*r) is (r/(r + d))^2.
  const double r = 7.0;
  const ClassicAttenuation a{1.0, 2.0 / r, 1.0 / (r * r), 0.0, 2.0};
  for (const double d : {0.0, 0.7, 7.0, 70.0}) EXPECT_NEAR(attenuation(a, d), std::pow(r / (r + d), 2.0), 1e-15);
}

TEST(Attenuation, WindowSaturatesTheDifference) {
  const ClassicAttenuation a{1.0, 0.0, 0.0, 4.0, 4.0};
  EXPECT_NEAR(attenuation(a, 2.0), 1.0 - 1.0 / 16.0, 1e-15);
  EXPECT_EQ(attenuation(a, 4.0), 0.0);
  EXPECT_EQ(attenuation(a, 8.0), 0.0) << "saturating the power instead would leave 0 only by chance";
}

TEST(Attenuation, GuardCasesStayFinite) {
  EXPECT_EQ(attenuation({0.0, 0.0, 0.0, 0.0, 2.0}, 1.0), 0.0);  // all zero
  EXPECT_EQ(attenuation({0.0, 1.0, 0.0, 0.0, 2.0}, 0.0), 0.0);  // d = 0 with c = 0
  EXPECT_EQ(attenuation({1.0, 0.0, 0.0, 0.0, 2.0}, 5.0), 1.0);  // range 0: no window
}

TEST(PointLight, IsCandelaOverDistanceSquared) {
  Light l;
  l.position_m = {0, 3, 0};
  l.intensity = Rgb(90.0f, 45.0f, 9.0f);
  const Incoming in = incoming(l, {4, 0, 0}, {0, 1, 0});
  // d = 5, cosine 3/5.
  EXPECT_NEAR(in.illuminance.x, 90.0 / 25.0 * 0.6, 1e-12);
  EXPECT_NEAR(in.illuminance.z, 9.0 / 25.0 * 0.6, 1e-12);
  EXPECT_EQ(incoming(l, {4, 0, 0}, {0, -1, 0}).illuminance, glm::dvec3(0.0));
  EXPECT_EQ(incoming(l, {0, 3, 0}, {0, 1, 0}).illuminance, glm::dvec3(0.0)) << "on the lamp itself";
  l.range_m = 5.0;
  EXPECT_EQ(incoming(l, {4, 0, 0}, {0, 1, 0}).illuminance, glm::dvec3(0.0)) << "the window ends at the range";
}

TEST(SpotLight, ConeIsTheSquaredRamp) {
  Light l;
  l.kind = Light::Kind::Spot;
  l.position_m = {0, 1, 0};
  l.direction = {0, -1, 0};
  l.intensity = Rgb(1.0f);
  l.cosInner = 0.9;
  l.cosOuter = 0.6;
  const auto at = [&](double cosine) {
    const double x = std::sqrt(1.0 / (cosine * cosine) - 1.0);                       // on the floor
    return incoming(l, {x, 0, 0}, {0, 1, 0}).illuminance.x / std::pow(cosine, 3.0);  // without cos and 1/d^2
  };
  EXPECT_NEAR(at(0.95), 1.0, 1e-12);
  EXPECT_NEAR(at(0.75), 0.25, 1e-12);  // half of the ramp, squared
  EXPECT_EQ(at(0.55), 0.0);
}

TEST(DirectionalLight, OneLuxAtNormalIncidenceIsOne) {
  Light l;
  l.kind = Light::Kind::Directional;
  l.direction = glm::normalize(glm::dvec3(0, -1, 1));
  l.intensity = Rgb(1.0f);
  EXPECT_NEAR(incoming(l, {9, 9, 9}, -l.direction).illuminance.x, 1.0, 1e-12);
  EXPECT_NEAR(incoming(l, {9, 9, 9}, {0, 1, 0}).illuminance.x, std::sqrt(0.5), 1e-12);
}

TEST(ClassicLight, ShowsItsColourOnAWhiteSurface) {
  // E = pi * colour * a, so that white (albedo 1) shows E/pi = colour where a = 1.
  Light l;
  l.position_m = {0, 2, 0};
  l.intensity = Rgb(0.5f);
  l.classic = ClassicAttenuation{};
  EXPECT_NEAR(incoming(l, {0, 0, 0}, {0, 1, 0}).illuminance.x / kPi, 0.5, 1e-12);
}

TEST(Culling, NeverLosesALightThatReaches) {
  // Every place of the sphere is tried; where any is lit, the light must be kept.
  Light l;
  l.kind = Light::Kind::Spot;
  l.intensity = Rgb(1.0f);
  l.range_m = 6.0;
  l.direction = glm::normalize(glm::dvec3(1, -2, 0.5));
  l.cosOuter = std::cos(0.5);
  l.cosInner = std::cos(0.2);
  int kept = 0, dropped = 0;
  for (int i = 0; i < 400; ++i) {
    const glm::dvec3 centre(5.0 * std::sin(i * 1.3), 5.0 * std::sin(i * 2.1), 5.0 * std::sin(i * 0.7));
    const double radius = 0.1 + (i % 7) * 0.4;
    bool lit = false;
    for (int k = 0; k < 500 && !lit; ++k) {
      const glm::dvec3 p = centre + radius * std::cbrt((k + 0.5) / 500.0) *
                                        glm::normalize(glm::dvec3(std::sin(k * 12.9), std::sin(k * 78.2), std::sin(k * 37.7)));
      lit = incoming(l, p, glm::normalize(l.position_m - p)).illuminance.x > 0.0;
    }
    const bool reach = mayReach(l, centre, radius);
    EXPECT_TRUE(reach || !lit) << i;
    ++(reach ? kept : dropped);
  }
  EXPECT_GT(kept, 20);
  EXPECT_GT(dropped, 100);  // the rule does settle something
}

}  // namespace
}  // namespace lmc
