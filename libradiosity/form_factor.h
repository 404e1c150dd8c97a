#pragma once
/// Form factors in closed form and by contour integral, all in double, without occluders.
/// F_ij = share of what leaves i that reaches j = 1/A_i int int cos cos/(pi d^2) dA_j dA_i; A_i F_ij = A_j F_ji.
#include <glm/glm.hpp>
#include <span>
#include <vector>

namespace lmc {

/// A flat polygon, convex or not, counter-clockwise seen from its front.
using Polygon3 = std::vector<glm::dvec3>;

/// The part of a polygon on the side of the plane that `normal` points to (Sutherland-Hodgman; for a concave polygon the parts hang
/// together by edges run through twice, which contour integrals do not see).
Polygon3 clippedToFront(std::span<const glm::dvec3> polygon, const glm::dvec3& origin, const glm::dvec3& normal);

/// Element at `position` with `normal` to a polygon [lambert1760]: 1/(2 pi) sum over edges of angle * normal . unit(r_k x r_k+1), the angle
/// by atan2, the part below the element's horizon cut off; by a cubature of the kernel where the polygon is far, for there the sum
/// cancels. 0 when the element is behind the polygon. In [0, 1].
double elementToPolygon(const glm::dvec3& position, const glm::dvec3& normal, std::span<const glm::dvec3> polygon);

/// The point form with the disc's denominator, cos cos A/(pi d^2 + A): never above 1. For far elements.
double elementToDisc(const glm::dvec3& position, const glm::dvec3& normal, const glm::dvec3& centre, const glm::dvec3& facing,
                     double area_m2);

/// A_1 F_12 of two polygons by the contour integral 1/(2 pi) sum of d1.d2 int int ln r [sparrow1963]; parallel edges in closed form; of
/// others the inner one in closed form, the outer by Gauss-Legendre on a mesh graded towards the places where the edges come near. Right
/// for touching polygons; in extended precision where the sum cancels (slivers, grazing places), by a cubature of the kernel where the
/// polygons are far. Each polygon counts only in front of the other's plane. `maxPanels`: of the outer edge, where edges run close and
/// almost parallel all along: the default resolves gaps of 1e-5 of their length to the last digits, 64 to some six. [m^2]
inline constexpr std::size_t kMaxPanels = 1 << 17;
double exchangeArea_m2(std::span<const glm::dvec3> from, std::span<const glm::dvec3> to, std::size_t maxPanels = kMaxPanels);
/// The same, always in extended precision: for enclosures whose answer is a small difference, albedo near 1. [m^2]
long double exchangeAreaExtended_m2(std::span<const glm::dvec3> from, std::span<const glm::dvec3> to);

glm::dvec3 polygonNormal(std::span<const glm::dvec3> polygon);  ///< twice the area times the unit normal (Newell)

}  // namespace lmc
