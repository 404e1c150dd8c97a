#pragma once
/// Form factors and solid angles of round and other bodies, unoccluded, to about 1e-12 of their value: nothing cancels on the way.
/// An element sees the half space of its normal; bodies shine to one side.
#include <span>

#include "libradiosity/form_factor.h"

namespace lmc {

/// Element to a disc [howell B-13 ff.], in any position and cut by the element's horizon. The kernel is summed over chords that lie at one
/// elevation, graded towards the element. `facing`, `normal` unit. In [0, 1]; 0 when the element is behind the disc.
double elementToRoundDisc(const glm::dvec3& position, const glm::dvec3& normal, const glm::dvec3& centre, const glm::dvec3& facing,
                          double radius_m);

/// Element to the outside of a sphere: cos (R/d)^2 when it is wholly above the horizon [howell B-42], else the projected part of its cone,
/// ring by ring. 0 for an element in the sphere. In [0, 1].
double elementToSphere(const glm::dvec3& position, const glm::dvec3& normal, const glm::dvec3& centre, double radius_m);
/// The same by the angle between the element's normal and the direction to the centre.
double elementToSphere(double angle_rad, double distance_m, double radius_m);

/// F_12 of two discs on one axis that face each other [howell C-41].
double coaxialDiscs(double radius1_m, double radius2_m, double distance_m);

/// Outer of two bodies about one centre, to the inner one and to itself, from the radii: dimensions = 2 for spheres, 1 for endless
/// cylinders. F_21 = (r1/r2)^dimensions, F_22 = 1 - F_21 without cancellation.
struct ConcentricFactors {
  long double outerToInner, outerToOuter;
};
ConcentricFactors concentricFactors(long double inner, long double outer, int dimensions);

/// Of a polygon that is seen from its front, else 0 [sr]. Triangle by triangle [oosterom1983], determinants from differences of the
/// corners.
double solidAngle_sr(const glm::dvec3& position, std::span<const glm::dvec3> polygon);

/// E of a light of 1 cd, mean over a flat polygon that faces it [lx]: what its illuminance cos/d^2 adds up to is a solid angle.
double meanOfPointLight(const glm::dvec3& light_m, std::span<const glm::dvec3> polygon);

/// Share of a sun's illuminance that passes a straight edge, on an element that faces the sun's centre. The sun has one radiance; seen is
/// what has direction.x/direction.z <= edgeOffset tan(angularRadius). The edge's great circle is half an ellipse in the projection that
/// makes illuminance an area.
double sunBesideEdge(double angularRadius_rad, double edgeOffset);

}  // namespace lmc
