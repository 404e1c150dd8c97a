#pragma once
/// Visible shares between polygons by rays: sum K V / sum K over scrambled places, K the point-to-point kernel, so that a share of 0 or 1
/// is exact and the closed form without blockers carries the rest.
#include <span>

#include "libradiosity/form_factor.h"
#include "libscene/rng.h"
#include "libscene/tracer.h"

namespace lmc {

/// Places on a polygon, uniform by area. For a polygon without area, or concave about its first corner, the fan's triangles count by size.
class PolygonSampler {
 public:
  explicit PolygonSampler(std::span<const glm::dvec3> polygon);
  glm::dvec3 at(glm::vec2 u) const;
  const glm::dvec3& normal() const { return normal_; }  ///< unit

 private:
  Polygon3 corners_;
  std::vector<double> cumulative_;
  glm::dvec3 normal_;
};

/// Share of the light of `to` that reaches `from`, with `pairs` places on each. 1 when nothing could be seen anyway. In [0, 1].
double visibleShare(const Tracer&, const PolygonSampler& from, const PolygonSampler& to, const Sobol4&, std::uint32_t pairs);

/// Share of what an element sees through an opening that is not hidden, however far behind the opening.
double visibleShareBeyond(const Tracer&, const glm::dvec3& position, const glm::dvec3& normal, const PolygonSampler& opening, const Sobol4&,
                          std::uint32_t rays);

}  // namespace lmc
