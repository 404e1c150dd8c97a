#include "libradiosity/visibility.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "libscene/rng.h"
#include "libscene/sampling.h"
#include "libscene/texels.h"

namespace lmc {

namespace {
constexpr std::uint32_t kFirstPairs = 16, kMorePairs = 64;
}

std::array<glm::dvec3, 3> leafCorners(const Scene& scene, const Leaf& leaf, bool back) {
  const auto c = scene.corners_m(leaf.triangle);
  std::array<glm::dvec3, 3> out;
  for (std::size_t k = 0; k < 3; ++k) out[k] = c[0] + double(leaf.bary[k].x) * (c[1] - c[0]) + double(leaf.bary[k].y) * (c[2] - c[0]);
  // Halving keeps the triangle's winding or turns it; the triangle itself says which way is front.
  const glm::dvec3 n = glm::cross(c[1] - c[0], c[2] - c[0]), m = glm::cross(out[1] - out[0], out[2] - out[0]);
  if ((glm::dot(n, m) < 0.0) != back) std::swap(out[1], out[2]);
  return out;
}

Ray exposedRay(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const Patch& patch, const glm::vec4& u,
               const Sobol4& places) {
  glm::vec2 at(u.z, u.w);
  if (patch.exposed != 0xffff) {
    const int exposed = std::popcount(patch.exposed);
    std::uint32_t bits = patch.exposed;
    for (int m = std::min(int(u.z * float(exposed)), exposed - 1); m > 0; --m) bits &= bits - 1;
    const glm::vec4 place = places.point(std::uint32_t(std::countr_zero(bits)));
    at = {place.z, place.w};
  }
  const auto [triangle, bary] = mesh.sample(patch, at);
  const SurfacePoint p = surfacePoint(scene, triangle, bary);
  const glm::dvec3 normal = patch.back ? -p.geometricNormal : p.geometricNormal;
  return {tracer.lifted(p.position_m, normal), glm::vec3(frameAbout(normal) * cosineHemisphere({u.x, u.y})), INFINITY};
}

bool mayFace(const Patch& a, const Patch& b) {
  const glm::dvec3 r = b.centre_m - a.centre_m;
  // Faces of a group bend by 0.35 rad at most: sin(0.35) of its radius off its mean plane, taken as half. The other reaches its radius
  // towards it.
  const auto inFront = [](const glm::dvec3& n, const glm::dvec3& d, double own, double other) {
    return glm::dot(n, d) > -(other + 0.5 * own);
  };
  return inFront(a.normal, r, a.radius_m, b.radius_m) && inFront(b.normal, -r, b.radius_m, a.radius_m);
}

double visibleShare(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, std::uint32_t i, std::uint32_t j, const Run& run) {
  const Patch &a = mesh.patches[i], &b = mesh.patches[j];
  const Sobol4 numbers = sequence(run.seed, Draw::Visibility, 0, 0, i, j, 0);
  double all = 0.0, clear = 0.0;
  for (std::uint32_t begin = 0, end = kFirstPairs; begin < kMorePairs; begin = end, end = kMorePairs) {
    std::array<Ray, kMorePairs> rays;
    std::array<double, kMorePairs> kernel;
    std::array<std::uint8_t, kMorePairs> blocked;
    std::size_t n = 0;
    for (std::uint32_t k = begin; k < end; ++k) {
      const glm::vec4 u = numbers.point(k);
      const auto [ta, ba] = mesh.sample(a, {u.x, u.y});
      const auto [tb, bb] = mesh.sample(b, {u.z, u.w});
      const SurfacePoint p = surfacePoint(scene, ta, ba), q = surfacePoint(scene, tb, bb);
      const glm::dvec3 np = a.back ? -p.geometricNormal : p.geometricNormal, nq = b.back ? -q.geometricNormal : q.geometricNormal;
      const glm::dvec3 r = q.position_m - p.position_m;
      const double d2 = glm::dot(r, r);
      const double K = std::max(0.0, glm::dot(r, np)) * std::max(0.0, -glm::dot(r, nq)) / (d2 * d2);
      if (!(K > 0.0)) continue;
      const glm::vec3 from = tracer.lifted(p.position_m, np), to = tracer.lifted(q.position_m, nq);
      rays[n] = {from, to - from, 1.0f};
      kernel[n++] = K;
    }
    tracer.occluded({rays.data(), n}, {blocked.data(), n}, Purpose::Visibility);
    for (std::size_t k = 0; k < n; ++k) {
      all += kernel[k];
      if (!blocked[k]) clear += kernel[k];
    }
    if (all > 0.0 && (clear == 0.0 || clear == all)) break;
  }
  return all > 0.0 ? clear / all : 1.0;
}

}  // namespace lmc
