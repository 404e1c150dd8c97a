#include "libradiosity/form_factor.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "libscene/constants.h"

namespace lmc {

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

// Gauss-Legendre, 10 points on [-1, 1], positive half.
constexpr std::array<double, 5> kNode{0.14887433898163121088, 0.43339539412924719080, 0.67940956829902440623, 0.86506336668898451073,
                                      0.97390652851717172008};
constexpr std::array<double, 5> kWeight{0.29552422471475287017, 0.26926671930999635509, 0.21908636251598204400, 0.14945134915058059315,
                                        0.06667134430868813759};

/// int over the edge a + t (b - a), t in [0, 1], of ln |p - x| dt, times |b - a|; the antiderivative of ln sqrt(s^2 + h^2) is
/// s ln sqrt(s^2 + h^2) - s + h atan(s/h).
double logIntegral(const glm::dvec3& p, const glm::dvec3& a, const glm::dvec3& direction, double length) {
  const glm::dvec3 r = p - a;
  const double s0 = glm::dot(r, direction);
  const double h = glm::length(r - s0 * direction);
  const auto antiderivative = [h](double s) {
    const double r2 = s * s + h * h;
    const double logPart = r2 > 0.0 ? 0.5 * s * std::log(r2) : 0.0;
    return logPart - s + (h > 0.0 ? h * std::atan2(s, h) : 0.0);
  };
  return antiderivative(s0) - antiderivative(s0 - length);
}

/// The integrand along the outer edge is smooth but where the inner edge is near: there panels halve until they are as long as the gap.
double outerIntegral(const glm::dvec3& a, const glm::dvec3& dir, double from, double to, const glm::dvec3& c, const glm::dvec3& innerDir,
                     double innerLength, int depth) {
  const double half = 0.5 * (to - from), mid = 0.5 * (to + from);
  const glm::dvec3 m = a + mid * dir;
  const double along = std::clamp(glm::dot(m - c, innerDir), 0.0, innerLength);
  const double gap = glm::length(m - (c + along * innerDir));
  if (depth > 0 && gap < 2.0 * half) {
    return outerIntegral(a, dir, from, mid, c, innerDir, innerLength, depth - 1) +
           outerIntegral(a, dir, mid, to, c, innerDir, innerLength, depth - 1);
  }
  double sum = 0.0;
  for (std::size_t k = 0; k < kNode.size(); ++k)
    sum += kWeight[k] * (logIntegral(a + (mid - half * kNode[k]) * dir, c, innerDir, innerLength) +
                         logIntegral(a + (mid + half * kNode[k]) * dir, c, innerDir, innerLength));
  return half * sum;
}

/// int int ln r over two segments of one line, one of them reversed or not: closed form, for there panels would halve along the whole edge.
double sameLineIntegral(double a0, double a1, double b0, double b1) {
  // G'' = ln |x|: G(x) = x^2/2 ln|x| - 3/4 x^2.
  const auto g = [](double x) { return x == 0.0 ? 0.0 : x * x * (0.5 * std::log(std::abs(x)) - 0.75); };
  return g(a1 - b0) - g(a1 - b1) - g(a0 - b0) + g(a0 - b1);
}

constexpr int kMaxHalvings = 24;

}  // namespace

double exchangeArea_m2(std::span<const glm::dvec3> from, std::span<const glm::dvec3> to) {
  if (from.size() < 3 || to.size() < 3) return 0.0;
  const Polygon3 p = clippedToFront(from, to[0], polygonNormal(to));
  const Polygon3 q = clippedToFront(to, from[0], polygonNormal(from));
  if (p.size() < 3 || q.size() < 3) return 0.0;
  double sum = 0.0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const glm::dvec3 a = p[i];
    const glm::dvec3 e1 = p[(i + 1) % p.size()] - a;
    const double l1 = glm::length(e1);
    if (!(l1 > 0.0)) continue;
    const glm::dvec3 d1 = e1 / l1;
    for (std::size_t k = 0; k < q.size(); ++k) {
      const glm::dvec3 c = q[k];
      const glm::dvec3 e2 = q[(k + 1) % q.size()] - c;
      const double l2 = glm::length(e2);
      if (!(l2 > 0.0)) continue;
      const glm::dvec3 d2 = e2 / l2;
      const double cosine = glm::dot(d1, d2);
      if (std::abs(cosine) < 1e-15) continue;
      const double scale = std::max(l1, l2);
      const glm::dvec3 w = c - a;
      const double offLine = std::max(glm::length(w - glm::dot(w, d1) * d1), glm::length(w + e2 - glm::dot(w + e2, d1) * d1));
      double integral = 0.0;
      if (offLine < 1e-13 * scale) {
        const double b0 = glm::dot(w, d1), b1 = glm::dot(w + e2, d1);
        integral = sameLineIntegral(0.0, l1, std::min(b0, b1), std::max(b0, b1));
      } else {
        integral = outerIntegral(a, d1, 0.0, l1, c, d2, l2, kMaxHalvings);
      }
      sum += cosine * integral;
    }
  }
  return std::max(0.0, sum / (2.0 * kPi));
}

}  // namespace lmc
