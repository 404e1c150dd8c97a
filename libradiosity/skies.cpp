#include "libradiosity/skies.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "libradiosity/quadrature.h"
#include "libscene/constants.h"

namespace lmc {

double skyRadiance(SkyKind kind, double sinElevation) {
  if (!(sinElevation > 0.0)) return 0.0;
  switch (kind) {
    case SkyKind::Uniform:
      return 1.0;
    case SkyKind::MoonSpencer:
      return (1.0 + 2.0 * sinElevation) / 3.0;
    case SkyKind::CieOvercast:
      return (1.0 + 4.0 * std::exp(-0.7 / sinElevation)) / (1.0 + 4.0 * std::exp(-0.7));
  }
  return 0.0;
}

double skyIlluminance(SkyKind kind, double tilt_rad) {
  const double tilt = std::clamp(std::abs(tilt_rad), 0.0, kPi);
  if (kind == SkyKind::Uniform) return kPi * std::pow(std::cos(0.5 * tilt), 2);
  // Direction at elevation g and azimuth phi from the slope: cos = sin g cos t + cos g sin t cos phi, positive for |phi| < phi0.
  const auto ring = [&](double g) {
    const double a = std::sin(g) * std::cos(tilt), b = std::cos(g) * std::sin(tilt);
    const double phi0 = a >= b ? kPi : a <= -b ? 0.0 : std::acos(std::clamp(-a / b, -1.0, 1.0));
    return skyRadiance(kind, std::sin(g)) * std::cos(g) * 2.0 * std::max(0.0, phi0 * a + std::sin(phi0) * b);
  };
  const double kink = std::min(tilt, kPi - tilt);  // rings above it are wholly in front (or wholly behind)
  const auto part = [&](double from, double to) {
    return to > from ? integrateTanhSinh(from, to, [&](double g, double) { return ring(g); }) : 0.0;
  };
  return part(0.0, std::min(kink, 0.5 * kPi)) + (tilt < 0.5 * kPi ? part(kink, 0.5 * kPi) : 0.0);
}

namespace {

using Corners = std::array<glm::dvec3, 3>;

/// int f(x) dA, triangles halved at their longest edge until none is longer than its distance from the element.
template <class F>
double overTriangle(const Corners& c, const glm::dvec3& element, const F& f, int depth) {
  std::size_t longest = 0;
  double edge = 0.0;
  for (std::size_t k = 0; k < 3; ++k)
    if (const double l = glm::distance(c[k], c[(k + 1) % 3]); l > edge) {
      edge = l;
      longest = k;
    }
  const glm::dvec3 centre = (c[0] + c[1] + c[2]) / 3.0;
  if (depth > 0 && edge > 0.75 * glm::distance(centre, element)) {
    const glm::dvec3 a = c[longest], b = c[(longest + 1) % 3], o = c[(longest + 2) % 3], mid = 0.5 * (a + b);
    return overTriangle({a, mid, o}, element, f, depth - 1) + overTriangle({mid, b, o}, element, f, depth - 1);
  }
  const auto& rule = gaussLegendre<double, 16>();
  const glm::dvec3 u = c[1] - c[0], v = c[2] - c[0];
  double sum = 0.0;
  for (std::size_t a = 0; a < 16; ++a)
    for (std::size_t b = 0; b < 16; ++b) {
      const double s = rule.node[a], t = rule.node[b];
      sum += s * rule.weight[a] * rule.weight[b] * f(c[0] + s * ((1.0 - t) * u + t * v));
    }
  return sum * glm::length(glm::cross(u, v));
}

}  // namespace

double skyThroughPolygon(SkyKind kind, const glm::dvec3& position, const glm::dvec3& normal, std::span<const glm::dvec3> polygon,
                         const glm::dvec3& up) {
  const Polygon3 seen = clippedToFront(clippedToFront(polygon, position, normal), position, up);
  if (seen.size() < 3) return 0.0;
  const glm::dvec3 plane = glm::normalize(polygonNormal(polygon));
  const double height = std::abs(glm::dot(position - polygon[0], plane));
  const auto kernel = [&](const glm::dvec3& x) {
    const glm::dvec3 r = x - position;
    const double r2 = glm::dot(r, r), r1 = std::sqrt(r2);
    return skyRadiance(kind, glm::dot(r, up) / r1) * std::max(0.0, glm::dot(r, normal)) / r2 * (height / r2);
  };
  double sum = 0.0;
  for (std::size_t i = 2; i < seen.size(); ++i) {
    const double side = glm::dot(glm::cross(seen[i - 1] - seen[0], seen[i] - seen[0]), plane);
    if (side != 0.0) sum += std::copysign(overTriangle({seen[0], seen[i - 1], seen[i]}, position, kernel, 60), side);
  }
  return std::max(0.0, sum);
}

}  // namespace lmc
