/// Closed forms and published values of form factors.
#include "libradiosity/form_factor.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>

#include "libscene/constants.h"

namespace lmc {
namespace {

using V = glm::dvec3;

Polygon3 rectangle(V o, V u, V v) { return {o, o + u, o + u + v, o + v}; }

const Polygon3 kFloor = rectangle(V(0, 0, 0), V(1, 0, 0), V(0, 1, 0));  // faces +z

/// Second rectangle of width w about the y axis at an angle; faces the floor.
Polygon3 hinged(double w, double length, double angle_deg) {
  const double a = angle_deg * kPi / 180.0;
  return {V(0, 0, 0), V(0, length, 0), V(w * std::cos(a), length, w * std::sin(a)), V(w * std::cos(a), 0, w * std::sin(a))};
}

TEST(FormFactor, UnitCubeFaces) {
  // [howell] C-11 and C-14; the two add up to 1 over the five other faces.
  const double opposite = exchangeArea_m2(kFloor, {rectangle(V(0, 0, 1), V(0, 1, 0), V(1, 0, 0))});
  const double side = exchangeArea_m2(kFloor, hinged(1, 1, 90));
  EXPECT_NEAR(opposite, 0.199824895698, 1e-11);
  EXPECT_NEAR(side, 0.200043776075, 1e-11);
  EXPECT_NEAR(opposite + 4.0 * side, 1.0, 1e-11);
}

TEST(FormFactor, TouchingRectanglesAtAnyAngle) {
  // Independent contour integrals of 30 digits.
  const std::pair<double, double> cases[] = {{15, 0.78517666391029838675},   {30, 0.61902832309080325340},   {45, 0.48334769547887775783},
                                             {60, 0.37090532115005143590},   {120, 0.086615001118276058831}, {135, 0.048309447801817941836},
                                             {165, 0.0053179859208317012460}};
  for (const auto& [angle, value] : cases) {
    EXPECT_NEAR(exchangeArea_m2(kFloor, hinged(1, 1, angle)), value, 1e-11) << angle << " degrees";
  }
}

TEST(FormFactor, ElementUnderTheCornerOfARectangle) {
  // F = 1/(2 pi) [ X/sqrt(1+X^2) atan(Y/sqrt(1+X^2)) + Y/sqrt(1+Y^2) atan(X/sqrt(1+Y^2)) ], X = a/h, Y = b/h.
  for (const double h : {1e-3, 0.1, 1.0, 30.0, 1e4}) {
    const double X = 2.0 / h, Y = 3.0 / h;
    const double exact =
        (X / std::sqrt(1 + X * X) * std::atan(Y / std::sqrt(1 + X * X)) + Y / std::sqrt(1 + Y * Y) * std::atan(X / std::sqrt(1 + Y * Y))) /
        (2.0 * kPi);
    const double got = elementToPolygon(V(0, 0, 0), V(0, 0, 1), rectangle(V(0, 0, h), V(0, 3, 0), V(2, 0, 0)));
    EXPECT_NEAR(got, exact, 1e-9 * exact) << "height " << h;
  }
}

TEST(FormFactor, HorizonCutsWhatIsBelow) {
  // A wall that stands on the element's plane and one that goes on below it give the same.
  const Polygon3 above = rectangle(V(1, -1, 0), V(0, 2, 0), V(0, 0, 1)), through = rectangle(V(1, -1, -5), V(0, 2, 0), V(0, 0, 6));
  const auto facing = [](Polygon3 p) {
    std::reverse(p.begin(), p.end());
    return p;
  };
  const double a = elementToPolygon(V(0), V(0, 0, 1), facing(above)), b = elementToPolygon(V(0), V(0, 0, 1), facing(through));
  EXPECT_GT(a, 0.05);
  EXPECT_NEAR(a, b, 1e-15);
  EXPECT_EQ(elementToPolygon(V(0), V(0, 0, -1), facing(above)), 0.0);
  EXPECT_EQ(elementToPolygon(V(0), V(0, 0, 1), above), 0.0) << "the wall's back";
}

TEST(FormFactor, DiscFormStaysBelowOneAndIsRightFar) {
  const Polygon3 square = rectangle(V(-0.5, -0.5, 0), V(0, 1, 0), V(1, 0, 0));  // faces -z
  for (const double h : {1e-6, 1e-2, 1.0}) EXPECT_LE(elementToDisc(V(0, 0, -h), V(0, 0, 1), V(0), V(0, 0, -1), 1.0), 1.0);
  const double exact = elementToPolygon(V(3, 2, -50), V(0, 0, 1), square);
  EXPECT_NEAR(elementToDisc(V(3, 2, -50), V(0, 0, 1), V(0), V(0, 0, -1), 1.0), exact, 4e-4 * exact);  // second order in size/distance
}

// Exchange areas are symmetric and add up over parts, whatever the two rectangles.
RC_GTEST_PROP(FormFactor, IsReciprocalAndAdditive, ()) {
  const auto number = [](const char*) { return double(*rc::gen::inRange(-1000, 1000)) / 500.0; };
  const V o(number("x"), number("y"), 0.3 + std::abs(number("z")));
  const V u(0.2 + std::abs(number("u")), 0, 0), v(0, -0.2 - std::abs(number("v")), number("tilt"));
  const Polygon3 p = rectangle(o, u, v);
  const double whole = exchangeArea_m2(kFloor, p);
  RC_ASSERT(std::abs(whole - exchangeArea_m2(p, kFloor)) < 1e-10);
  const double parts = exchangeArea_m2(kFloor, rectangle(o, 0.37 * u, v)) + exchangeArea_m2(kFloor, rectangle(o + 0.37 * u, 0.63 * u, v));
  RC_ASSERT(std::abs(whole - parts) < 1e-10);
  RC_ASSERT(whole >= 0.0 && whole <= 1.0 + 1e-12);
}

}  // namespace
}  // namespace lmc
