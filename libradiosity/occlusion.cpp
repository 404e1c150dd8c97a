#include "libradiosity/occlusion.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace lmc {

namespace {

constexpr std::uint32_t kBatch = 256;

struct WeightedRay {
  Ray ray;
  double weight = 0.0;  ///< the kernel; 0 = not worth a ray
};

/// make(k): the k-th ray.
template <class Make>
double clearShare(const Tracer& tracer, std::uint32_t count, const Make& make) {
  std::array<Ray, kBatch> rays;
  std::array<double, kBatch> weights;
  std::array<std::uint8_t, kBatch> blocked;
  double all = 0.0, clear = 0.0;
  for (std::uint32_t begin = 0; begin < count; begin += kBatch) {
    std::size_t n = 0;
    for (std::uint32_t k = begin; k < std::min(count, begin + kBatch); ++k) {
      const WeightedRay r = make(k);
      if (!(r.weight > 0.0)) continue;
      rays[n] = r.ray;
      weights[n++] = r.weight;
    }
    tracer.occluded({rays.data(), n}, {blocked.data(), n}, Purpose::Visibility);
    for (std::size_t i = 0; i < n; ++i) {
      all += weights[i];
      if (!blocked[i]) clear += weights[i];
    }
  }
  return all > 0.0 ? clear / all : 1.0;
}

double kernel(const glm::dvec3& r, double cosineFrom, double cosineTo) {
  const double r2 = glm::dot(r, r);
  return std::max(0.0, cosineFrom) * std::max(0.0, cosineTo) / (r2 * r2);
}

}  // namespace

PolygonSampler::PolygonSampler(std::span<const glm::dvec3> polygon)
    : corners_(polygon.begin(), polygon.end()), normal_(glm::normalize(polygonNormal(polygon))) {
  double sum = 0.0;
  for (std::size_t i = 2; i < corners_.size(); ++i)
    cumulative_.push_back(sum += glm::length(glm::cross(corners_[i - 1] - corners_[0], corners_[i] - corners_[0])));
}

glm::dvec3 PolygonSampler::at(glm::vec2 u) const {
  double pick = double(u.x) * cumulative_.back();
  std::size_t t = std::size_t(std::ranges::upper_bound(cumulative_, pick) - cumulative_.begin());
  t = std::min(t, cumulative_.size() - 1);
  const double before = t > 0 ? cumulative_[t - 1] : 0.0;
  const double s = std::sqrt(std::clamp((pick - before) / (cumulative_[t] - before), 0.0, 1.0));
  return corners_[0] + s * ((1.0 - double(u.y)) * (corners_[t + 1] - corners_[0]) + double(u.y) * (corners_[t + 2] - corners_[0]));
}

double visibleShare(const Tracer& tracer, const PolygonSampler& from, const PolygonSampler& to, const Sobol4& numbers,
                    std::uint32_t pairs) {
  return clearShare(tracer, pairs, [&](std::uint32_t k) {
    const glm::vec4 u = numbers.point(k);
    const glm::dvec3 p = from.at({u.x, u.y}), q = to.at({u.z, u.w}), r = q - p;
    const glm::vec3 start = tracer.lifted(p, from.normal()), end = tracer.lifted(q, to.normal());
    return WeightedRay{{start, end - start, 1.0f}, kernel(r, glm::dot(r, from.normal()), -glm::dot(r, to.normal()))};
  });
}

double visibleShareBeyond(const Tracer& tracer, const glm::dvec3& position, const glm::dvec3& normal, const PolygonSampler& opening,
                          const Sobol4& numbers, std::uint32_t rays) {
  return clearShare(tracer, rays, [&](std::uint32_t k) {
    const glm::dvec3 r = opening.at(numbers.point2(k)) - position;
    return WeightedRay{{glm::vec3(position), glm::vec3(r), INFINITY},
                       kernel(r, glm::dot(r, normal), std::abs(glm::dot(r, opening.normal())))};
  });
}

}  // namespace lmc
