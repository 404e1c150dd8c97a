#include "libradiosity/path_tracer.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "libradiosity/emitters.h"
#include "libradiosity/lights.h"
#include "libradiosity/patch_mesh.h"
#include "libscene/constants.h"
#include "libscene/rng.h"
#include "libscene/sampling.h"
#include "libscene/texture.h"

namespace lmc {

namespace {

constexpr std::uint32_t kBatch = 256;       // paths in one stream of rays
constexpr std::size_t kAllLights = 8;       // punctual lights that the texel's own places ask one by one
constexpr std::size_t kWeighedLights = 64;  // so many are weighed by what they would give; of more, so many are drawn first

/// Random numbers of one path, each by its bounce and its purpose.
enum Number : std::uint64_t { LightChoice, EmitterChoice, EmitterU, EmitterV, DirectionU, DirectionV, Roulette, Candidates };
double numberOf(std::uint64_t path, int bounce, std::uint64_t which) {
  return double(combine(path, std::uint64_t(bounce) << 32 | which) >> 11) * 0x1p-53;
}

Rgb shiningAt(const Scene& scene, std::uint32_t triangle, glm::vec2 bary) {
  const Material& m = scene.materialOf(triangle);
  if (m.alpha == Material::Alpha::Mask && alphaAt(scene, triangle, bary) < m.alphaCutoff) return Rgb(0.0f);
  return emissionAt(scene, triangle, bary);
}

}  // namespace

/// Paths under way together: their rays go as one stream.
struct PathTracer::Batch {
  struct Path {
    std::uint64_t name;        // of its random numbers
    SurfacePoint at;           // where the next ray starts
    SurfacePoint lit;          // where direct light is asked for: at the texel another place than `at`, with numbers of its own
    glm::vec2 emitterU{0.0f};  // first vertex: where on the emitter
    glm::vec2 direction{0.0f};
    glm::dvec3 throughput{1.0};
  };
  int vertex = 0;  // 0 = the texel
  std::vector<Path> paths;
  glm::dvec3 sum{0.0};
  std::vector<Ray> rays;
  std::vector<glm::dvec3> gain;  // of each ray, should nothing be in its way
  std::vector<std::uint8_t> blocked;
  std::vector<Hit> hits;
};

PathTracer::PathTracer(const Scene& scene, const Tracer& tracer, const PathOptions& options)
    : scene_(scene), tracer_(tracer), options_(options) {
  double sum = 0.0;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    const Material& m = scene.materialOf(t);
    if (strength(m.emission) <= 0.0f || isDegenerate(scene.corners_m(t))) continue;
    const double area = area_m2(scene.corners_m(t)), power = area * double(strength(m.emission)) * (m.doubleSided ? 2.0 : 1.0);
    emitters_.push_back({t, area, power, m.doubleSided, scene.objectOf(t).cast && m.opaqueToLight()});
    sum += power;
    upTo_.push_back(sum);
  }
  if (emitters_.empty()) return;
  emitterOf_.assign(scene.triangles.size(), kNone);
  for (std::uint32_t i = 0; i < emitters_.size(); ++i) {
    emitters_[i].chance /= sum;
    upTo_[i] /= sum;
    emitterOf_[emitters_[i].triangle] = i;
  }
}

Ray PathTracer::towards(const SurfacePoint& p, const glm::dvec3& way_m, bool endless) const {
  const glm::vec3 from = tracer_.lifted(p.position_m, p.geometricNormal);
  if (endless) return {from, glm::vec3(way_m), INFINITY};
  // The ray ends a little before its goal: a lamp that lies in a surface is not hidden by it, nor an emitter by itself.
  const glm::dvec3 way = p.position_m + way_m - glm::dvec3(from);
  return {from, glm::vec3(way), float(std::max(0.0, 1.0 - 4.0 * double(tracer_.lift_m()) / glm::length(way)))};
}

void PathTracer::addPunctual(Batch& b, bool first) const {
  const std::size_t n = scene_.lights.size();
  if (n == 0) return;
  const auto ask = [&](const Batch::Path& path, const Incoming& in, double weight) {
    if (!(strength(Rgb(in.illuminance)) > 0.0f) || glm::dot(in.towards, path.lit.geometricNormal) <= 0.0) return;
    b.rays.push_back(towards(path.lit, in.towards, in.endless));
    b.gain.push_back(weight * path.throughput * in.illuminance);
  };
  std::array<Incoming, kWeighedLights> in;
  std::array<double, kWeighedLights> upTo;
  for (const Batch::Path& path : b.paths) {
    if (first && n <= kAllLights) {
      for (const Light& l : scene_.lights) ask(path, incoming(l, path.lit.position_m, path.lit.normal), 1.0);
      continue;
    }
    // One light in proportion to what it would give. Of many lights, candidates are drawn evenly first; each then stands for n/candidates
    // [talbot2005].
    const std::size_t candidates = std::min(n, kWeighedLights);
    double sum = 0.0;
    for (std::size_t k = 0; k < candidates; ++k) {
      const std::size_t light = n <= kWeighedLights ? k : std::size_t(numberOf(path.name, b.vertex, Candidates + k) * double(n));
      in[k] = incoming(scene_.lights[std::min(light, n - 1)], path.lit.position_m, path.lit.normal);
      sum += double(strength(Rgb(in[k].illuminance)));
      upTo[k] = sum;
    }
    if (!(sum > 0.0)) continue;
    const double u = sum * numberOf(path.name, b.vertex, LightChoice);
    const std::size_t k =
        std::min(std::size_t(std::upper_bound(upTo.begin(), upTo.begin() + std::ptrdiff_t(candidates), u) - upTo.begin()), candidates - 1);
    const double own = double(strength(Rgb(in[k].illuminance)));
    if (own > 0.0) ask(path, in[k], sum / own * double(n) / double(candidates));
  }
}

/// Density of places on an emitter, per area.
double PathTracer::densityOf(std::uint32_t triangle) const {
  const Shining& e = emitters_[emitterOf_[triangle]];
  return e.chance / e.area_m2;
}

void PathTracer::addEmitters(Batch& b) const {
  if (emitters_.empty()) return;
  for (const Batch::Path& path : b.paths) {
    const bool first = b.vertex == 0;
    const double choice = numberOf(path.name, b.vertex, EmitterChoice);
    const std::size_t k = std::min(std::size_t(std::upper_bound(upTo_.begin(), upTo_.end(), choice) - upTo_.begin()), emitters_.size() - 1);
    const Shining& e = emitters_[k];
    const double u = first ? double(path.emitterU.x) : numberOf(path.name, b.vertex, EmitterU),
                 v = first ? double(path.emitterU.y) : numberOf(path.name, b.vertex, EmitterV);
    const double s = std::sqrt(u);
    const glm::vec2 bary(float(s * (1.0 - v)), float(s * v));
    const SurfacePoint at = surfacePoint(scene_, e.triangle, glm::dvec2(bary));
    const glm::dvec3 way = at.position_m - path.lit.position_m;
    const double d2 = glm::dot(way, way), d = std::sqrt(d2);
    const double cosine = glm::dot(path.lit.normal, way) / d;
    double leaving = -glm::dot(at.geometricNormal, way) / d;
    if (e.back) leaving = std::abs(leaving);
    if (!(d > 0.0) || cosine <= 0.0 || leaving <= 0.0 || glm::dot(path.lit.geometricNormal, way) <= 0.0) continue;
    const glm::dvec3 radiance(shiningAt(scene_, e.triangle, bary));
    // Densities in solid angle of this way of finding it, and of a cosine ray's.
    const double own = densityOf(e.triangle) * d2 / leaving, other = cosine / kPi;
    const bool both = options_.shadows && e.blocks;  // else no ray meets it
    b.rays.push_back(towards(path.lit, way, false));
    b.gain.push_back(path.throughput * radiance * (cosine / (both ? own + other : own)));
  }
}

void PathTracer::direct(Batch& b, bool first) const {
  b.rays.clear();
  b.gain.clear();
  addPunctual(b, first);
  addEmitters(b);
  b.blocked.assign(b.rays.size(), 0);
  if (options_.shadows) tracer_.occluded(b.rays, b.blocked, Purpose::Audit);
  for (std::size_t i = 0; i < b.rays.size(); ++i)
    if (!b.blocked[i]) b.sum += b.gain[i];
}

/// Casts each path's next ray; those that met something that reflects go on from there.
void PathTracer::bounce(Batch& b, int bounces) const {
  b.rays.clear();
  std::vector<Batch::Path> going;
  std::vector<double> density;  // of the direction, in solid angle
  for (const Batch::Path& path : b.paths) {
    const glm::dvec3 d = frameAbout(path.at.normal) * cosineHemisphere(path.direction);
    if (glm::dot(d, path.at.geometricNormal) <= 0.0) continue;  // below the face itself: blocked
    going.push_back(path);
    density.push_back(glm::dot(d, path.at.normal) / kPi);
    b.rays.push_back({tracer_.lifted(path.at.position_m, path.at.geometricNormal), glm::vec3(d), INFINITY});
  }
  b.hits.assign(b.rays.size(), {});
  tracer_.closest(b.rays, b.hits, Purpose::Audit);
  b.paths.clear();
  for (std::size_t i = 0; i < going.size(); ++i) {
    Batch::Path& path = going[i];
    const Hit& hit = b.hits[i];
    if (!hit) {
      b.sum += kPi * path.throughput * glm::dvec3(scene_.sky);
      continue;
    }
    const Material& m = scene_.materialOf(hit.triangle);
    if (!hit.front && !m.doubleSided) continue;
    if (options_.shadows && !emitterOf_.empty() && emitterOf_[hit.triangle] != kNone) {
      const Facet facet(scene_, hit.triangle);
      const glm::dvec3 direction(b.rays[i].direction), normal = facet.at(glm::dvec2(hit.bary)).geometricNormal;
      const double leaving = std::abs(glm::dot(normal, direction)) / glm::length(direction);
      const double distance = double(hit.t) * glm::length(direction);
      const double other = leaving > 0.0 ? densityOf(hit.triangle) * distance * distance / leaving : INFINITY;
      b.sum += kPi * path.throughput * glm::dvec3(shiningAt(scene_, hit.triangle, hit.bary)) * (density[i] / (density[i] + other));
    }
    if (bounces == b.vertex) continue;
    const glm::dvec3 albedo(glm::min(reflectanceAt(scene_, hit.triangle, hit.bary), Rgb(kMostReflectance)));
    // Roulette with what the path would carry: it goes on with a largest channel of what it had.
    const glm::dvec3 carried = path.throughput * albedo;
    const double before = std::max({path.throughput.x, path.throughput.y, path.throughput.z}),
                 after = std::max({carried.x, carried.y, carried.z}), stays = after / before;
    if (!(after > 0.0) || numberOf(path.name, b.vertex, Roulette) >= stays) continue;
    path.throughput = carried / stays;
    path.at = surfacePoint(scene_, hit.triangle, glm::dvec2(hit.bary));
    if (!hit.front) {
      path.at.normal = -path.at.normal;
      path.at.geometricNormal = -path.at.geometricNormal;
    }
    path.lit = path.at;
    path.direction = {float(numberOf(path.name, b.vertex, DirectionU)), float(numberOf(path.name, b.vertex, DirectionV))};
    b.paths.push_back(path);
  }
  ++b.vertex;
}

glm::dvec3 PathTracer::sum(const TexelSampler& sampler, std::uint64_t key, std::uint32_t begin, std::uint32_t end) const {
  const Sobol4 ways(combine(key, 1)), lights(combine(key, 2));
  const bool dark = scene_.lights.empty() && emitters_.empty();
  glm::dvec3 sum(0.0);
  Batch b;
  for (std::uint32_t first = begin; first < end; first += kBatch) {
    b.paths.clear();
    b.vertex = 0;
    b.sum = glm::dvec3(0.0);
    for (std::uint32_t k = first; k < std::min(end, first + kBatch); ++k) {
      const glm::vec4 way = ways.point(k), light = lights.point(k);
      Batch::Path path;
      path.name = combine(combine(key, 3), k);
      path.at = sampler.at({way.z, way.w});
      path.lit = sampler.at({light.z, light.w});
      path.emitterU = {light.x, light.y};
      path.direction = {way.x, way.y};
      b.paths.push_back(path);
    }
    while (!b.paths.empty()) {
      if (!dark) direct(b, b.vertex == 0);
      // Without bounces, rays that could meet neither sky nor emitters would bring nothing.
      if (options_.bounces >= 0 && b.vertex >= options_.bounces && !(strength(scene_.sky) > 0.0f) && emitters_.empty()) break;
      bounce(b, options_.bounces);
    }
    sum += b.sum;
  }
  return sum;
}

}  // namespace lmc
