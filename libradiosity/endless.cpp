#include "libradiosity/endless.h"

#include <algorithm>
#include <cmath>

#include "libradiosity/zonal.h"
#include "libscene/constants.h"

namespace lmc {

namespace {

double share(int k, int n) { return 0.5 * (1.0 - std::cos(kPi * k / n)); }

/// Front of a strip, not unit.
glm::dvec2 front(const glm::dvec2& from, const glm::dvec2& to) { return {from.y - to.y, to.x - from.x}; }

}  // namespace

EndlessEnclosure::EndlessEnclosure(std::span<const Strip> strips, int panels) : strips_(strips.begin(), strips.end()) {
  for (std::size_t s = 0; s < strips.size(); ++s)
    for (int k = 0; k < panels; ++k) {
      const glm::dvec2 way = strips[s].to - strips[s].from;
      const glm::dvec2 a = strips[s].from + share(k, panels) * way, b = strips[s].from + share(k + 1, panels) * way;
      panels_.push_back({a, b, s, (share(k + 1, panels) - share(k, panels)) * glm::length(way)});
    }
  const std::size_t n = panels_.size();
  std::vector<long double> factors(n * n, 0.0L), emission(n), albedo(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Panel& p = panels_[i];
    emission[i] = strips[p.strip].emission;
    albedo[i] = strips[p.strip].albedo;
    for (std::size_t j = 0; j < n; ++j) {
      const Panel& q = panels_[j];
      if (p.strip == q.strip) continue;
      // Strings from end to end: both run counter-clockwise about the room, so ends of unlike name are joined by the uncrossed ones.
      const double crossed = glm::distance(p.from, q.from) + glm::distance(p.to, q.to);
      const double uncrossed = glm::distance(p.from, q.to) + glm::distance(p.to, q.from);
      factors[i * n + j] = std::max(0.0, crossed - uncrossed) / (2.0 * p.length);
    }
  }
  const ZonalSolution solution = solveZonal(factors, emission, albedo);
  radiosity_.assign(solution.radiosity.begin(), solution.radiosity.end());
  illuminance_.assign(solution.illuminance.begin(), solution.illuminance.end());
}

double EndlessEnclosure::mean(std::size_t strip) const {
  double sum = 0.0, width = 0.0;
  for (std::size_t i = 0; i < panels_.size(); ++i)
    if (panels_[i].strip == strip) {
      sum += panels_[i].length * illuminance_[i];
      width += panels_[i].length;
    }
  return sum / width;
}

double EndlessEnclosure::at(std::size_t strip, double where) const {
  const Strip& s = strips_[strip];
  const glm::dvec2 x = s.from + where * (s.to - s.from), along = glm::normalize(s.to - s.from), n = glm::normalize(front(s.from, s.to));
  // Factor of a piece: half the difference of the sines of the angles from the normal under which its ends are seen.
  const auto sine = [&](const glm::dvec2& end, const glm::dvec2& other) {
    glm::dvec2 d = end - x;
    // A piece that touches the place is seen there along itself.
    if (glm::length(d) < 1e-14 * glm::length(s.to - s.from)) d = other - x;
    return glm::dot(d, along) / glm::length(d);
  };
  double sum = 0.0;
  for (std::size_t j = 0; j < panels_.size(); ++j) {
    const Panel& p = panels_[j];
    if (p.strip == strip || glm::dot(0.5 * (p.from + p.to) - x, n) <= 0.0) continue;
    sum += 0.5 * std::abs(sine(p.from, p.to) - sine(p.to, p.from)) * radiosity_[j];
  }
  return sum;
}

}  // namespace lmc
