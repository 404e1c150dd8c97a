#include "libradiosity/form_factor_bodies.h"

#include <algorithm>
#include <cmath>

#include "libradiosity/quadrature.h"
#include "libscene/constants.h"
#include "libscene/sampling.h"

namespace lmc {

double elementToRoundDisc(const glm::dvec3& position, const glm::dvec3& normal, const glm::dvec3& centre, const glm::dvec3& facing,
                          double radius_m) {
  const double R = radius_m;
  const double height = glm::dot(position - centre, facing);
  if (!(height > 0.0) || !(R > 0.0)) return 0.0;
  // In the disc's plane: s along the slope of the elevation n.(x - p) = e0 + s slope, t along lines of one elevation.
  const glm::dvec3 gradient = normal - glm::dot(normal, facing) * facing;
  const double slope = glm::length(gradient);
  const glm::dvec3 S = slope > 1e-150 ? gradient / slope : frameAbout(facing)[0], T = glm::cross(facing, S);
  const double e0 = glm::dot(centre - position, normal);
  if (!(e0 + slope * R > 0.0)) return 0.0;
  const glm::dvec3 foot = position - centre;
  const double footS = glm::dot(foot, S), footT = glm::dot(foot, T);
  // s = -R cos(psi): chords of half length R sin(psi), and the ends of the disc are no singularity.
  const bool cut = e0 < slope * R;
  const double first = cut ? std::acos(std::clamp(e0 / (slope * R), -1.0, 1.0)) : 0.0;
  const auto elevation = [&](double psi) {
    return cut ? 2.0 * slope * R * std::sin(0.5 * (psi + first)) * std::sin(0.5 * (psi - first)) : e0 - slope * R * std::cos(psi);
  };
  // Angles count from the chord under the element, places along a chord from the point under it: differences to them stay exact, however
  // near the element is.
  const double under = std::acos(std::clamp(-footS / R, -1.0, 1.0)), beside = std::max(0.0, std::abs(footS) - R);
  const auto across = [&](double delta) {
    const double within = 2.0 * R * std::sin(under + 0.5 * delta) * std::sin(0.5 * delta);  // s less that of the chord under the element
    return std::abs(within) + beside;
  };
  const auto chord = [&](double delta) {
    const double half = R * std::sin(under + delta), rho2 = height * height + std::pow(across(delta), 2);
    return integrateGraded(
        -half - footT, half - footT, [&](double t) { return 1.0 / ((rho2 + t * t) * (rho2 + t * t)); },
        [&](double t) { return std::sqrt(rho2 + t * t); });
  };
  const auto toChord = [&](double delta) {
    const double beyond = std::max(0.0, std::abs(footT) - R * std::sin(under + delta));
    return std::min(1.0, std::sqrt(height * height + std::pow(across(delta), 2) + beyond * beyond) / R);
  };
  const auto rings = [&](double from, double to) {
    return to > from
               ? integrateGraded(
                     from, to,
                     [&](double delta) { return std::max(0.0, elevation(under + delta)) * chord(delta) * R * std::sin(under + delta); },
                     toChord)
               : 0.0;
  };
  const double sum = rings(first - under, std::min(0.0, kPi - under)) + rings(std::max(0.0, first - under), kPi - under);
  return std::clamp(sum * height / kPi, 0.0, 1.0);
}

namespace {

/// sin x - x cos x, by its series where that is a small difference.
double sineLess(double x) {
  if (x > 0.5) return std::sin(x) - x * std::cos(x);
  double term = x * x * x / 3.0, sum = term;  // sum over k >= 1 of (-1)^(k+1) 2k/(2k+1)! x^(2k+1)
  for (int k = 2; k < 12; ++k) {
    term *= -x * x * double(k) / (double(k - 1) * double(2 * k) * double(2 * k + 1));
    sum += term;
  }
  return sum;
}

/// Projected solid angle over pi of a cone of half angle `cone` about a direction at `elevation` above the horizon, the part below cut off.
double elementToCone(double sinElevation, double cosElevation, double elevation, double cone) {
  if (elevation >= cone) return sinElevation * std::sin(cone) * std::sin(cone);
  if (elevation <= -cone) return 0.0;
  // Rings about the axis: whole ones up to |elevation| (none when the axis is below), of others the part with cos(phi) > -tan e/tan beta.
  const double whole = elevation > 0.0 ? sinElevation * sinElevation * sinElevation : 0.0;
  const double start = std::abs(elevation);
  const double partly = integrateTanhSinh(start, cone, [&](double beta, double beyond) {
    const double sinBeta = std::sin(beta), cosine = -std::copysign(std::tan(start) / std::tan(beta), elevation);
    const double sine = std::sqrt(std::max(0.0, std::sin(beyond) * std::sin(beta + start))) / (sinBeta * cosElevation);
    return 2.0 * cosElevation * sinBeta * sinBeta * sineLess(std::atan2(sine, cosine));
  });
  return std::clamp(whole + partly / kPi, 0.0, 1.0);
}

}  // namespace

double elementToSphere(const glm::dvec3& position, const glm::dvec3& normal, const glm::dvec3& centre, double radius_m) {
  const glm::dvec3 r = centre - position;
  const double along = glm::dot(r, normal), across = glm::length(glm::cross(r, normal)), d = glm::length(r);
  if (!(d > radius_m) || !(radius_m > 0.0)) return 0.0;
  const double cone = std::atan2(radius_m, std::sqrt((d - radius_m) * (d + radius_m)));
  return elementToCone(along / d, across / d, std::atan2(along, across), cone);
}

double elementToSphere(double angle_rad, double distance_m, double radius_m) {
  if (!(distance_m > radius_m) || !(radius_m > 0.0)) return 0.0;
  const double cone = std::atan2(radius_m, std::sqrt((distance_m - radius_m) * (distance_m + radius_m)));
  const double elevation = 0.5 * kPi - angle_rad;
  return elementToCone(std::sin(elevation), std::cos(elevation), elevation, cone);
}

double coaxialDiscs(double radius1_m, double radius2_m, double distance_m) {
  // F = (S - sqrt(S^2 - 4 k^2))/2 with k = r2/r1, S = 1 + k^2 + (d/r1)^2, times its conjugate: S^2 - 4k^2 = (S - 2k)(S + 2k).
  const double k = radius2_m / radius1_m, h = distance_m / radius1_m;
  const double less = (1.0 - k) * (1.0 - k) + h * h, more = (1.0 + k) * (1.0 + k) + h * h;
  return 2.0 * k * k / (0.5 * (less + more) + std::sqrt(less * more));
}

ConcentricFactors concentricFactors(long double inner, long double outer, int dimensions) {
  const long double q = inner / outer, gap = (outer - inner) / outer;
  return dimensions == 2 ? ConcentricFactors{q * q, gap * (1.0L + q)} : ConcentricFactors{q, gap};
}

double solidAngle_sr(const glm::dvec3& position, std::span<const glm::dvec3> polygon) {
  if (polygon.size() < 3 || glm::dot(position - polygon[0], polygonNormal(polygon)) <= 0.0) return 0.0;
  const glm::dvec3 a = polygon[0] - position;
  double sum = 0.0;
  for (std::size_t i = 2; i < polygon.size(); ++i) {
    const glm::dvec3 b = polygon[i - 1] - position, c = polygon[i] - position;
    const double la = glm::length(a), lb = glm::length(b), lc = glm::length(c);
    const double triple = -glm::dot(a, glm::cross(polygon[i - 1] - polygon[0], polygon[i] - polygon[0]));
    sum += 2.0 * std::atan2(triple, la * lb * lc + glm::dot(a, b) * lc + glm::dot(b, c) * la + glm::dot(c, a) * lb);
  }
  return std::max(0.0, sum);
}

double meanOfPointLight(const glm::dvec3& light_m, std::span<const glm::dvec3> polygon) {
  return solidAngle_sr(light_m, polygon) / (0.5 * glm::length(polygonNormal(polygon)));
}

double sunBesideEdge(double angularRadius_rad, double edgeOffset) {
  if (edgeOffset >= 1.0) return 1.0;
  if (edgeOffset <= -1.0) return 0.0;
  const double s = std::sin(angularRadius_rad);
  const double edge = std::atan(std::abs(edgeOffset) * std::tan(angularRadius_rad)), tau = std::sin(edge);
  // The disc of radius s and the ellipse x = tau sqrt(1 - y^2) cross at y0; the area between the y axis and the edge is
  // tau asin y0 + s^2 acos(y0/s).
  const double y0 = std::sqrt(std::max(0.0, std::sin(angularRadius_rad + edge) * std::sin(angularRadius_rad - edge))) / std::cos(edge);
  const double beyond = std::atan2(tau * std::sqrt(1.0 - y0 * y0), y0);  // acos(y0/s)
  const double area = tau * std::asin(y0) + s * s * beyond;
  return std::clamp(0.5 + std::copysign(area / (kPi * s * s), edgeOffset), 0.0, 1.0);
}

}  // namespace lmc
