#include "libradiosity/gather.h"

#include <array>

#include "libscene/sampling.h"

namespace lmc {

namespace {

constexpr std::uint32_t kBatch = 256;
constexpr float kTouching = 0.1f;

}  // namespace

void Gather::addNear(Gathered& out, std::span<const NearHit> hits, std::uint64_t key, int half) const {
  std::array<Ray, kBatch> rays;
  std::array<Hit, kBatch> met;
  std::array<Rgb, kBatch> reflectance;
  std::size_t n = 0;
  for (const NearHit& near : hits) {
    const Rgb* rho = field_->reflectanceAt(near.hit);
    if (!rho) continue;
    SurfacePoint p = surfacePoint(scene_, near.hit.triangle, glm::dvec2(near.hit.bary));
    if (!near.hit.front) {
      p.normal = -p.normal;
      p.geometricNormal = -p.geometricNormal;
    }
    const Sobol4 numbers(combine(key, near.index));
    const Rgb* sure = field_->sureDirectAt(near.hit);
    const glm::dvec3 direct = sure ? glm::dvec3(*sure) : direct_.sample({&p, 1}, direct_.lightsFor(p.position_m, 0.0), numbers).illuminance;
    const glm::dvec3 back = double(near.weight) * glm::dvec3(*rho) * direct;
    out.bounced += back;
    out.coarse += back;
    const glm::vec4 u = numbers.point(0);
    const glm::dvec3 d = frameAbout(p.normal) * cosineHemisphere({u.z, u.w});
    if (glm::dot(d, p.geometricNormal) <= 0.0) continue;
    reflectance[n] = near.weight * *rho;
    rays[n++] = {tracer_.lifted(p.position_m, p.geometricNormal), glm::vec3(d), INFINITY};
  }
  tracer_.closest({rays.data(), n}, {met.data(), n}, Purpose::Near);
  for (std::size_t i = 0; i < n; ++i) {
    if (!met[i]) {
      const glm::dvec3 sky = kPi * glm::dvec3(reflectance[i] * scene_.sky);
      out.bounced += sky;
      out.coarse += sky;
      continue;
    }
    const Field::Seen seen = field_->at(met[i], half);
    out.bounced += glm::dvec3(reflectance[i] * seen.exitance);
    out.coarse += glm::dvec3(reflectance[i] * seen.coarse);
  }
}

Gathered Gather::rays(const TexelTile& tile, int x, int y, int half, std::uint32_t begin, std::uint32_t end, Guide& guide) const {
  const TexelSampler sampler(scene_, tile, tile.at(x, y));
  const Sobol4 numbers =
      sequence(seed_, Draw::Hemisphere, 0, 0, std::uint32_t(tile.x0 + x), std::uint32_t(tile.y0 + y), std::uint32_t(half));
  Gathered out;
  std::array<Ray, kBatch> rays;
  std::array<Hit, kBatch> hits;
  std::array<std::uint8_t, kBatch> blocked;
  std::array<std::uint32_t, kBatch> index;
  std::array<glm::vec2, kBatch> towards;  // in the unit square
  std::array<float, kBatch> weight;
  std::vector<NearHit> near;
  const float sky = float(kPi) * (scene_.sky.r + scene_.sky.g + scene_.sky.b);
  guide.count(end - begin);
  for (std::uint32_t first = begin; first < end; first += kBatch) {
    std::size_t n = 0;
    for (std::uint32_t k = first; k < std::min(end, first + kBatch); ++k) {
      const glm::vec4 u = numbers.point(k);
      const SurfacePoint p = sampler.at({u.z, u.w});
      towards[n] = guide.warp({u.x, u.y}, weight[n]);
      const glm::dvec3 d = frameAbout(p.normal) * cosineHemisphere(towards[n]);
      if (glm::dot(d, p.geometricNormal) <= 0.0) continue;
      index[n] = k;
      rays[n++] = {tracer_.lifted(p.position_m, p.geometricNormal), glm::vec3(d), INFINITY};
    }
    if (!field_) {
      tracer_.occluded({rays.data(), n}, {blocked.data(), n}, Purpose::Sky);
      for (std::size_t i = 0; i < n; ++i) {
        if (blocked[i]) continue;
        out.sky += double(weight[i]);
        guide.add(towards[i], sky, weight[i]);
      }
      continue;
    }
    tracer_.closest({rays.data(), n}, {hits.data(), n}, Purpose::Gather);
    for (std::size_t i = 0; i < n; ++i) {
      if (!hits[i]) {
        out.sky += double(weight[i]);
        guide.add(towards[i], sky, weight[i]);
        continue;
      }
      const Field::Seen seen = field_->at(hits[i], half);
      guide.add(towards[i], seen.exitance.r + seen.exitance.g + seen.exitance.b, weight[i]);
      const bool isNear = hits[i].t < nearSizes_ * seen.size_m;
      out.near += isNear;
      out.touching += hits[i].t < kTouching * nearSizes_ * seen.size_m;
      const glm::dvec3 back = double(weight[i]) * glm::dvec3(seen.exitance);
      if (isNear) out.nearLight += back;
      if (nearHits_ && isNear) {
        near.push_back({hits[i], index[i], weight[i]});
        continue;
      }
      out.bounced += back;
      out.coarse += double(weight[i]) * glm::dvec3(seen.coarse);
    }
    if (!near.empty()) {
      std::uint64_t key = combine(combine(seed_, std::uint64_t(Draw::NearHit)), std::uint64_t(half));
      key = combine(key, (std::uint64_t(tile.x0 + x) << 32) | std::uint64_t(tile.y0 + y));
      addNear(out, near, key, half);
      near.clear();
    }
  }
  return out;
}

}  // namespace lmc
