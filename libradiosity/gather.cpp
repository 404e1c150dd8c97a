#include "libradiosity/gather.h"

#include <array>

#include "libscene/sampling.h"

namespace lmc {

Gathered Gather::rays(const TexelTile& tile, int x, int y, int half, std::uint32_t begin, std::uint32_t end) const {
  constexpr std::uint32_t kBatch = 256;
  const Texel& texel = tile.at(x, y);
  const Sobol4 numbers = sequence(seed_, Draw::Hemisphere, 0, 0, std::uint32_t(tile.x0 + x), std::uint32_t(tile.y0 + y), std::uint32_t(half));
  Gathered out;
  std::array<Ray, kBatch> rays;
  std::array<Hit, kBatch> hits;
  std::array<std::uint8_t, kBatch> blocked;
  for (std::uint32_t first = begin; first < end; first += kBatch) {
    std::size_t n = 0;
    for (std::uint32_t k = first; k < std::min(end, first + kBatch); ++k) {
      const glm::vec4 u = numbers.point(k);
      const SurfacePoint p = sampleTexel(scene_, tile, texel, {u.z, u.w});
      const glm::dvec3 d = frameAbout(p.normal) * cosineHemisphere({u.x, u.y});
      if (glm::dot(d, p.geometricNormal) <= 0.0) continue;
      rays[n++] = {tracer_.lifted(p.position_m, p.geometricNormal), glm::vec3(d), INFINITY};
    }
    if (!field_) {
      tracer_.occluded({rays.data(), n}, {blocked.data(), n}, Purpose::Sky);
      for (std::size_t i = 0; i < n; ++i) out.sky += blocked[i] == 0;
      continue;
    }
    tracer_.closest({rays.data(), n}, {hits.data(), n}, Purpose::Gather);
    for (std::size_t i = 0; i < n; ++i) {
      if (!hits[i]) {
        ++out.sky;
        continue;
      }
      const Field::Seen seen = field_->at(hits[i], half);
      out.bounced += glm::dvec3(seen.exitance);
      out.coarse += glm::dvec3(seen.coarse);
    }
  }
  return out;
}

}  // namespace lmc
