#include "libradiosity/direct.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>

#include "libradiosity/form_factor.h"
#include "libradiosity/lights.h"
#include "libscene/constants.h"

namespace lmc {

namespace {

constexpr std::size_t kMaxEmitterPieces = 48;  // when a level has few emissive triangles
constexpr std::size_t kClosedFormPlaces = 4;   // the unoccluded factor is smooth over a texel
constexpr double kDefensive = 0.05;  // share of the choice of pieces that goes by power alone: a place may see what the first one does not
constexpr std::size_t kLeastDraws = 4;
constexpr std::size_t kMaxPlaces = 256;

}  // namespace

DirectLight::DirectLight(const Scene& scene, const Tracer& tracer, bool shadows)
    : scene_(scene), tracer_(tracer), shadows_(shadows), emitters_(findEmitters(scene, kMaxEmitterPieces)), rays_(scene.lights.size()) {}

std::vector<std::uint32_t> DirectLight::lightsFor(const glm::dvec3& centre_m, double radius_m) const {
  std::vector<std::uint32_t> lights;
  for (std::uint32_t i = 0; i < scene_.lights.size(); ++i)
    if (mayReach(scene_.lights[i], centre_m, radius_m)) lights.push_back(i);
  return lights;
}

DirectSample DirectLight::sample(std::span<const SurfacePoint> places, std::span<const std::uint32_t> lights, const Sobol4& address) const {
  assert(places.size() <= kMaxPlaces);
  DirectSample out;
  for (const std::uint32_t light : lights) addPunctual(out, places, light);
  if (hasEmitters()) addEmitters(out, places, address);
  return out;
}

void DirectLight::trace(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Purpose purpose) const {
  if (shadows_)
    tracer_.occluded(rays, blocked, purpose);
  else
    std::ranges::fill(blocked, std::uint8_t(0));
}

void DirectLight::addPunctual(DirectSample& out, std::span<const SurfacePoint> places, std::uint32_t index) const {
  const Light& light = scene_.lights[index];
  std::array<Ray, kMaxPlaces> rays;
  std::array<glm::dvec3, kMaxPlaces> unshadowed;
  std::array<std::uint8_t, kMaxPlaces> blocked;
  std::size_t n = 0;
  for (const SurfacePoint& p : places) {
    const Incoming in = incoming(light, p.position_m, p.normal);
    if (in.illuminance == glm::dvec3(0.0)) continue;
    if (glm::dot(in.towards, p.geometricNormal) <= 0.0) continue;  // lit by the interpolated normal only: the surface itself is in the way
    unshadowed[n] = in.illuminance;
    const glm::vec3 from = tracer_.lifted(p.position_m, p.geometricNormal);
    if (in.endless) {
      rays[n] = {from, glm::vec3(in.towards), INFINITY};
    } else {
      // The ray ends a little before the lamp: one that lies in a surface, or touches it, is not hidden by it.
      const glm::dvec3 way = light.position_m - glm::dvec3(from);
      rays[n] = {from, glm::vec3(way), float(std::max(0.0, 1.0 - 2.0 * double(tracer_.lift_m()) / glm::length(way)))};
    }
    ++n;
  }
  if (n == 0) return;
  trace({rays.data(), n}, {blocked.data(), n}, Purpose::Shadow);
  if (shadows_) rays_[index].fetch_add(n, std::memory_order_relaxed);
  std::size_t seen = 0;
  for (std::size_t i = 0; i < n; ++i) {
    if (blocked[i]) continue;
    ++seen;
    out.illuminance += unshadowed[i] / double(places.size());
  }
  out.mixed |= seen > 0 && seen < places.size();  // the edge of a cone or of the light's side counts as an edge, too
  if (seen > 0) out.signature = combine(out.signature, index);
}

void DirectLight::addEmitters(DirectSample& out, std::span<const SurfacePoint> places, const Sobol4& address) const {
  // A place on the lamp or in its plane gets nothing from it; rounding must not say otherwise.
  const double inPlane_m = double(tracer_.lift_m());
  const auto inFront = [&](const SurfacePoint& p, const Emitter& e) {
    return p.triangle != e.triangle && glm::dot(p.position_m - e.corner_m[0], e.normal) > inPlane_m;
  };

  // E without blockers, closed form, mean over a few of the places.
  glm::dvec3 unoccluded(0.0);
  const std::size_t closed = std::min(kClosedFormPlaces, places.size());
  for (const Emitter& e : emitters_.whole) {
    double factor = 0.0;
    for (std::size_t i = 0; i < closed; ++i)
      if (inFront(places[i], e)) factor += elementToPolygon(places[i].position_m, places[i].normal, e.corner_m) / double(closed);
    unoccluded += kPi * factor * glm::dvec3(e.radiance);
  }
  if (unoccluded == glm::dvec3(0.0)) return;

  // The choice of pieces: by what they would give to the first place (disc form) as a share of each channel, so that the only blue lamp
  // among many red ones is not forgotten, and a little by power alone.
  const std::vector<Emitter>& pieces = emitters_.pieces;
  thread_local std::vector<double> factor, cumulative;
  factor.assign(pieces.size(), 0.0);
  glm::dvec3 given(0.0), power(0.0);
  for (std::size_t e = 0; e < pieces.size(); ++e) {
    if (!inFront(places[0], pieces[e])) continue;
    const glm::dvec3 centre = (pieces[e].corner_m[0] + pieces[e].corner_m[1] + pieces[e].corner_m[2]) / 3.0;
    factor[e] = elementToDisc(places[0].position_m, places[0].normal, centre, pieces[e].normal, pieces[e].area_m2);
    given += factor[e] * glm::dvec3(pieces[e].radiance);
    power += pieces[e].area_m2 * glm::dvec3(pieces[e].radiance);
  }
  const auto shares = [](const glm::dvec3& part, const glm::dvec3& whole) {
    double sum = 0.0;
    for (int c = 0; c < 3; ++c) sum += whole[c] > 0.0 ? part[c] / whole[c] : 0.0;
    return sum;
  };
  cumulative.resize(pieces.size() + 1);
  cumulative[0] = 0.0;
  for (std::size_t e = 0; e < pieces.size(); ++e) {
    double share = 0.0;
    if (inFront(places[0], pieces[e])) {
      const glm::dvec3 L(pieces[e].radiance);
      share = (1.0 - kDefensive) * shares(factor[e] * L, given) + kDefensive * shares(pieces[e].area_m2 * L, power);
    }
    cumulative[e + 1] = cumulative[e] + share;
  }
  if (!(cumulative.back() > 0.0)) return;

  std::array<Ray, kMaxPlaces> rays;
  std::array<glm::dvec3, kMaxPlaces> radiance,
      mean;  // times kernel over density: what counts when seen, and what would count if nothing were in the way
  std::array<std::uint8_t, kMaxPlaces> blocked;
  std::size_t n = 0;
  // A ratio of few terms says little: a single place draws several.
  for (std::size_t i = 0; i < std::max(places.size(), kLeastDraws); ++i) {
    const SurfacePoint& p = places[i % places.size()];
    const glm::vec2 u = address.point2(std::uint32_t(i));
    const double pick = double(u.x) * cumulative.back();
    std::size_t e = std::size_t(std::ranges::upper_bound(cumulative, pick) - cumulative.begin()) - 1;
    e = std::min(e, pieces.size() - 1);
    const Emitter& emitter = pieces[e];
    const double share = cumulative[e + 1] - cumulative[e];
    if (!(share > 0.0)) continue;
    const double s = std::sqrt(std::clamp((pick - cumulative[e]) / share, 0.0, 1.0));
    const double w1 = s * (1.0 - double(u.y)), w2 = s * double(u.y);
    const glm::dvec3 q =
        emitter.corner_m[0] + w1 * (emitter.corner_m[1] - emitter.corner_m[0]) + w2 * (emitter.corner_m[2] - emitter.corner_m[0]);
    const glm::dvec3 r = q - p.position_m;
    const double d2 = glm::dot(r, r);
    const double kernel = std::max(0.0, glm::dot(r, p.normal)) * std::max(0.0, -glm::dot(r, emitter.normal)) / (kPi * d2 * d2);
    if (!(kernel > 0.0) || !std::isfinite(kernel) || !inFront(p, emitter)) continue;
    const double weight = kernel * emitter.area_m2 / share;
    radiance[n] = mean[n] = weight * glm::dvec3(emitter.radiance);
    if (glm::dot(r, p.geometricNormal) <= 0.0) radiance[n] = glm::dvec3(0.0);  // behind the surface itself
    const glm::vec3 from = tracer_.lifted(p.position_m, p.geometricNormal), to = tracer_.lifted(q, emitter.normal);
    rays[n] = {from, to - from, 1.0f};
    ++n;
  }
  if (n == 0) return;
  trace({rays.data(), n}, {blocked.data(), n}, Purpose::Emitter);
  glm::dvec3 seenSum(0.0), allSum(0.0);
  std::size_t seen = 0;
  for (std::size_t i = 0; i < n; ++i) {
    allSum += mean[i];
    if (blocked[i]) continue;
    ++seen;
    seenSum += radiance[i];
  }
  for (int c = 0; c < 3; ++c)
    if (unoccluded[c] > 0.0) {
      // No draw met a lamp of this colour: it counts as hidden as much as the others are.
      const double share =
          allSum[c] > 0.0 ? seenSum[c] / allSum[c] : (seenSum.x + seenSum.y + seenSum.z) / (allSum.x + allSum.y + allSum.z);
      out.illuminance[c] += unoccluded[c] * share;
    }
  out.mixed |= seen > 0 && seen < n;
  if (seen > 0) out.signature = combine(out.signature, 0xe417);
}

}  // namespace lmc
