#include "libradiosity/form_factor.h"

#include <algorithm>
#include <cmath>

#include "libradiosity/quadrature.h"
#include "libscene/constants.h"

namespace lmc {

namespace {

// Lambert's sum and contour integrals are differences: digits go in proportion to distance over size, twice for oblique places. From here
// on the kernel itself is summed, with rules whose error falls by 32 (16 + sqrt(255)) with each half node and direction.
constexpr double kFarElement = 16.0, kFarPolygons = 8.0;

/// Calls f(place, weight) for the 5 x 5 (or N x N) places of a product rule on each triangle of the fan; weights add up to the area. A
/// concave polygon's fan has triangles of negative area.
template <std::size_t N, class F>
void overPolygon(std::span<const glm::dvec3> p, const glm::dvec3& unitNormal, const F& f) {
  const auto& rule = gaussLegendre<double, N>();
  for (std::size_t i = 2; i < p.size(); ++i) {
    const glm::dvec3 u = p[i - 1] - p[0], v = p[i] - p[0];
    const double area2 = glm::dot(glm::cross(u, v), unitNormal);
    for (std::size_t a = 0; a < N; ++a)
      for (std::size_t b = 0; b < N; ++b) {
        const double s = rule.node[a], t = rule.node[b];
        f(p[0] + s * ((1.0 - t) * u + t * v), area2 * s * rule.weight[a] * rule.weight[b]);
      }
  }
}

struct Ball {
  glm::dvec3 centre;
  double radius;
};

Ball ballOf(std::span<const glm::dvec3> p) {
  Ball b{glm::dvec3(0.0), 0.0};
  for (const glm::dvec3& c : p) b.centre += (c - p[0]) / double(p.size());
  b.centre += p[0];
  for (const glm::dvec3& c : p) b.radius = std::max(b.radius, glm::distance(c, b.centre));
  return b;
}

double farElementToPolygon(const glm::dvec3& position, const glm::dvec3& normal, std::span<const glm::dvec3> p, const glm::dvec3& facing) {
  const double height = glm::dot(position - p[0], facing);
  double sum = 0.0;
  overPolygon<5>(p, facing, [&](const glm::dvec3& x, double weight) {
    const glm::dvec3 r = x - position;
    const double r2 = glm::dot(r, r);
    sum += weight * std::max(0.0, glm::dot(r, normal)) / r2 * (height / r2);
  });
  return std::clamp(sum / kPi, 0.0, 1.0);
}

}  // namespace

glm::dvec3 polygonNormal(std::span<const glm::dvec3> p) {
  glm::dvec3 n(0.0);
  for (std::size_t i = 2; i < p.size(); ++i) n += glm::cross(p[i - 1] - p[0], p[i] - p[0]);
  return n;
}

Polygon3 clippedToFront(std::span<const glm::dvec3> polygon, const glm::dvec3& origin, const glm::dvec3& normal) {
  Polygon3 out;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const glm::dvec3& a = polygon[i];
    const glm::dvec3& b = polygon[(i + 1) % polygon.size()];
    const double da = glm::dot(a - origin, normal), db = glm::dot(b - origin, normal);
    if (da >= 0.0) out.push_back(a);
    if ((da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0)) out.push_back(a + (b - a) * (da / (da - db)));
  }
  return out;
}

double elementToPolygon(const glm::dvec3& position, const glm::dvec3& normal, std::span<const glm::dvec3> polygon) {
  if (polygon.size() < 3) return 0.0;
  const glm::dvec3 facing = polygonNormal(polygon);
  if (glm::dot(position - polygon[0], facing) <= 0.0) return 0.0;
  Polygon3 cut;
  std::span<const glm::dvec3> p;
  bool below = false, above = false;
  for (const glm::dvec3& c : polygon) (glm::dot(c - position, normal) < 0.0 ? below : above) = true;
  if (!above) return 0.0;
  if (below) {
    cut = clippedToFront(polygon, position, normal);
    p = cut;
  } else {
    p = polygon;
  }
  if (p.size() < 3) return 0.0;
  const Ball ball = ballOf(p);
  if (glm::distance(position, ball.centre) > kFarElement * ball.radius)
    return farElementToPolygon(position, normal, p, glm::normalize(facing));
  double sum = 0.0;
  glm::dvec3 a = p[p.size() - 1] - position;
  for (const glm::dvec3& corner : p) {
    const glm::dvec3 b = corner - position;
    const glm::dvec3 c = glm::cross(a, b);
    const double s = glm::length(c);
    if (s > 0.0) sum += std::atan2(s, glm::dot(a, b)) * glm::dot(normal, c) / s;
    a = b;
  }
  // Seen from its front a counter-clockwise polygon runs clockwise about the direction to it: hence the sign.
  return std::clamp(-sum / (2.0 * kPi), 0.0, 1.0);
}

double elementToDisc(const glm::dvec3& position, const glm::dvec3& normal, const glm::dvec3& centre, const glm::dvec3& facing,
                     double area_m2) {
  const glm::dvec3 r = centre - position;
  const double d2 = glm::dot(r, r);
  const double c = glm::dot(r, normal) * -glm::dot(r, facing);
  if (!(c > 0.0) || glm::dot(r, normal) <= 0.0) return 0.0;
  return c / d2 * area_m2 / (kPi * d2 + area_m2);
}

namespace {

template <class Real>
using Vec3 = glm::vec<3, Real, glm::defaultp>;

/// int over the edge a + t (b - a), t in [0, 1], of ln |p - x| dt, times |b - a|; the antiderivative of ln sqrt(s^2 + h^2) is
/// s ln sqrt(s^2 + h^2) - s + h atan(s/h).
template <class Real>
Real logIntegral(const Vec3<Real>& p, const Vec3<Real>& a, const Vec3<Real>& direction, Real length) {
  const Vec3<Real> r = p - a;
  const Real s0 = glm::dot(r, direction);
  const Real h = glm::length(r - s0 * direction);
  const auto antiderivative = [h](Real s) {
    const Real r2 = s * s + h * h;
    const Real logPart = r2 > 0 ? s * std::log(r2) / 2 : Real(0);
    return logPart - s + (h > 0 ? h * std::atan2(s, h) : Real(0));
  };
  return antiderivative(s0) - antiderivative(s0 - length);
}

template <class Real>
struct Edge {
  Vec3<Real> from, direction;
  Real length;
};

/// The integrand along the outer edge is smooth but where the inner edge is near: there panels halve until they are as long as the gap.
/// Near one place that is a few panels a level. Where whole edges run close and almost parallel it would be all of them, level after level:
/// there the gap hardly changes over a panel, and halving ends at `maxPanels` of a level.
template <class Real>
Real outerIntegral(const Edge<Real>& outer, const Edge<Real>& inner, int maxHalvings, std::size_t maxPanels) {
  const auto& rule = gaussLegendre<Real, 16>();
  Real sum = 0;
  std::vector<std::pair<Real, Real>> level{{Real(0), outer.length}}, next;
  for (int depth = 0; !level.empty(); ++depth, std::swap(level, next)) {
    next.clear();
    const bool mayHalve = depth < maxHalvings && level.size() <= maxPanels;
    for (const auto& [begin, end] : level) {
      const Real mid = (begin + end) / 2;
      const Vec3<Real> m = outer.from + mid * outer.direction;
      const Real along = std::clamp(glm::dot(m - inner.from, inner.direction), Real(0), inner.length);
      const Real gap = glm::length(m - (inner.from + along * inner.direction));
      if (mayHalve && gap < end - begin) {
        next.emplace_back(begin, mid);
        next.emplace_back(mid, end);
        continue;
      }
      Real panel = 0;
      for (std::size_t k = 0; k < 16; ++k)
        panel += rule.weight[k] * logIntegral(Vec3<Real>(outer.from + (begin + (end - begin) * rule.node[k]) * outer.direction), inner.from,
                                              inner.direction, inner.length);
      sum += (end - begin) * panel;
    }
  }
  return sum;
}

/// int int ln r over two edges of parallel lines at distance h, [0, length] and [b0, b1] along the first: closed form, for with a small gap
/// panels would halve along the whole edge. G'' = ln sqrt(x^2 + h^2): G = (x^2 - h^2)/4 ln(x^2 + h^2) - 3/4 x^2 + h x atan(x/h).
template <class Real>
Real parallelIntegral(Real length, Real b0, Real b1, Real h) {
  const auto g = [h](Real x) {
    const Real r2 = x * x + h * h;
    if (!(r2 > 0)) return Real(0);
    return (x * x - h * h) / 4 * std::log(r2) - 3 * x * x / 4 + (h > 0 ? h * x * std::atan2(x, h) : Real(0));
  };
  return g(length - b0) - g(length - b1) - g(-b0) + g(-b1);
}

template <class Real>
std::vector<Edge<Real>> edgesOf(std::span<const glm::dvec3> p, const glm::dvec3& origin, Real scale) {
  std::vector<Edge<Real>> edges;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const Vec3<Real> a = (Vec3<Real>(p[i]) - Vec3<Real>(origin)) / scale,
                     b = (Vec3<Real>(p[(i + 1) % p.size()]) - Vec3<Real>(origin)) / scale;
    const Real length = glm::length(b - a);
    if (length > 0) edges.push_back({a, (b - a) / length, length});
  }
  return edges;
}

/// 1/(2 pi) sum over pairs of edges; in units of `scale`, so that logarithms stay small.
template <class Real>
Real contourIntegral(std::span<const glm::dvec3> p, std::span<const glm::dvec3> q, Real scale, std::size_t maxPanels) {
  constexpr Real kParallel = Real(1e-14);                   // sine of the angle: rounding of the corners, no more
  constexpr int kMaxHalvings = sizeof(Real) > 8 ? 32 : 24;  // x ln x over the last panel is below the last digit
  const auto outer = edgesOf<Real>(p, p[0], scale), inner = edgesOf<Real>(q, p[0], scale);
  Real sum = 0;
  for (const Edge<Real>& a : outer)
    for (const Edge<Real>& b : inner) {
      const Real cosine = glm::dot(a.direction, b.direction);
      if (std::abs(cosine) < Real(1e-17)) continue;
      if (glm::length(glm::cross(a.direction, b.direction)) < kParallel) {
        const Vec3<Real> w = b.from - a.from;
        const Real b0 = glm::dot(w, a.direction), b1 = b0 + cosine * b.length;
        const Real h = glm::length(w - b0 * a.direction);
        sum += cosine * parallelIntegral(a.length, std::min(b0, b1), std::max(b0, b1), h < Real(1e-18) ? Real(0) : h);
      } else {
        sum += cosine * outerIntegral(a, b, kMaxHalvings, maxPanels);
      }
    }
  return sum / Real(2.0L * 3.14159265358979323846264338327950288L);
}

struct FacingParts {
  Polygon3 from, to;  // empty when they do not face
};

/// Each cut at the other's plane.
FacingParts facingParts(std::span<const glm::dvec3> from, std::span<const glm::dvec3> to) {
  if (from.size() < 3 || to.size() < 3) return {};
  constexpr double kInPlane = 1e-14;  // of the distance: what lies in the other's plane but for rounding sees nothing of it
  const glm::dvec3 n1 = polygonNormal(from), n2 = polygonNormal(to);
  const auto anyInFront = [](std::span<const glm::dvec3> p, const glm::dvec3& origin, const glm::dvec3& n) {
    for (const glm::dvec3& c : p)
      if (glm::dot(c - origin, n) > kInPlane * glm::length(n) * glm::length(c - origin)) return true;
    return false;
  };
  if (!anyInFront(from, to[0], n2) || !anyInFront(to, from[0], n1)) return {};
  FacingParts parts{clippedToFront(from, to[0], n2), clippedToFront(to, from[0], n1)};
  if (parts.from.size() < 3 || parts.to.size() < 3) return {};
  return parts;
}

/// Sum of the kernel for polygons far apart.
double farExchange(std::span<const glm::dvec3> p, std::span<const glm::dvec3> q) {
  const glm::dvec3 np = glm::normalize(polygonNormal(p)), nq = glm::normalize(polygonNormal(q));
  double sum = 0.0;
  overPolygon<6>(p, np, [&](const glm::dvec3& x, double wx) {
    const double height = std::max(0.0, glm::dot(x - q[0], nq));
    double inner = 0.0;
    overPolygon<6>(q, nq, [&](const glm::dvec3& y, double wy) {
      const glm::dvec3 r = y - x;
      const double r2 = glm::dot(r, r);
      inner += wy * std::max(0.0, glm::dot(r, np)) / r2 * (height / r2);
    });
    sum += wx * inner;
  });
  return sum / kPi;
}

}  // namespace

double exchangeArea_m2(std::span<const glm::dvec3> from, std::span<const glm::dvec3> to, std::size_t maxPanels) {
  const FacingParts parts = facingParts(from, to);
  if (parts.from.empty()) return 0.0;
  const Ball a = ballOf(parts.from), b = ballOf(parts.to);
  if (glm::distance(a.centre, b.centre) > kFarPolygons * (a.radius + b.radius)) return farExchange(parts.from, parts.to);
  // What is small against the edges (slivers, grazing places) is a small difference of large integrals: there extended precision.
  constexpr double kSmallDifference = 1e-3;
  const double scale = std::max(a.radius, b.radius);
  const double result = contourIntegral<double>(parts.from, parts.to, scale, maxPanels);
  if (result > kSmallDifference) return result * scale * scale;
  return double(std::max(0.0L, contourIntegral<long double>(parts.from, parts.to, (long double)(scale), maxPanels))) * scale * scale;
}

long double exchangeAreaExtended_m2(std::span<const glm::dvec3> from, std::span<const glm::dvec3> to) {
  const FacingParts parts = facingParts(from, to);
  if (parts.from.empty()) return 0.0L;
  const Ball a = ballOf(parts.from), b = ballOf(parts.to);
  if (glm::distance(a.centre, b.centre) > kFarPolygons * (a.radius + b.radius)) return farExchange(parts.from, parts.to);
  const long double scale = std::max(a.radius, b.radius);
  return std::max(0.0L, contourIntegral<long double>(parts.from, parts.to, scale, kMaxPanels)) * scale * scale;
}

}  // namespace lmc
