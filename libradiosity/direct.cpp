#include "libradiosity/direct.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <optional>

#include "libradiosity/form_factor.h"
#include "libradiosity/lights.h"
#include "libscene/constants.h"

namespace lmc {

namespace {

constexpr std::size_t kMaxEmitterPieces = 24;  // when a level has few emissive triangles
constexpr std::size_t kClosedFormPlaces = 4;   // the unoccluded factor is smooth over a texel
constexpr double kDefensive = 0.05;  // share of the choice of pieces that goes by power alone: a place may see what the first one does not
constexpr std::size_t kLeastDraws = 4;
constexpr double kFarEmitter = 8.0;           // times its size: there the disc form is right to 0.2 %
constexpr double kNearEmitter = 2.0;          // times its size: farther off its solid angle is small, and places on it give much the same
constexpr double kNearbyTexel = 2.0;          // times a texel's diameter from a place in it: farther off 16 places see 1/d^2 to 1 %
constexpr double kLeastSolidAngle_sr = 1e-6;  // below it the angles of a spherical triangle lose their digits
constexpr std::size_t kMaxPlaces = 256;

/// Form factor of a place to an emitter without blockers.
double unoccludedFactor(const SurfacePoint& p, const Emitter& e) {
  const glm::dvec3 centre = (e.corner_m[0] + e.corner_m[1] + e.corner_m[2]) / 3.0;
  const glm::dvec3 r = centre - p.position_m;
  const bool far = glm::dot(r, r) > kFarEmitter * kFarEmitter * e.longest2_m2 && glm::dot(r, p.normal) > std::sqrt(e.longest2_m2);
  return far ? elementToDisc(p.position_m, p.normal, centre, e.normal, e.area_m2) : elementToPolygon(p.position_m, p.normal, e.corner_m);
}

bool isNear(const SurfacePoint& p, const Emitter& e) {
  const glm::dvec3 r = (e.corner_m[0] + e.corner_m[1] + e.corner_m[2]) / 3.0 - p.position_m;
  return glm::dot(r, r) < kNearEmitter * kNearEmitter * e.longest2_m2;
}

/// The triangle as a place sees it, for places on it by solid angle [arvo1995].
class SphericalTriangle {
 public:
  SphericalTriangle(const glm::dvec3& from_m, const std::array<glm::dvec3, 3>& corner_m) {
    for (int k = 0; k < 3; ++k) corner_[k] = glm::normalize(corner_m[k] - from_m);
    const auto& [a, b, c] = corner_;
    // [oosterom1983]
    solidAngle_sr_ = 2.0 * std::atan2(std::abs(glm::dot(a, glm::cross(b, c))), 1.0 + glm::dot(a, b) + glm::dot(b, c) + glm::dot(c, a));
    const glm::dvec3 toB = glm::cross(a, b), toC = glm::cross(a, c);
    alpha_ = std::atan2(glm::length(glm::cross(toB, toC)), glm::dot(toB, toC));
  }
  double solidAngle_sr() const { return solidAngle_sr_; }
  /// Uniform in solid angle for u, v uniform in [0, 1): a unit direction.
  glm::dvec3 direction(double u, double v) const {
    const auto& [a, b, c] = corner_;
    // The arc from b to `cut`, on the arc from a to c, cuts off u of the solid angle.
    const double phi = u * solidAngle_sr_ - alpha_;
    const double s = std::sin(phi), t = std::cos(phi), cosC = glm::dot(a, b), sinAlpha = std::sin(alpha_), cosAlpha = std::cos(alpha_);
    const double x = t - cosAlpha, y = s + sinAlpha * cosC;
    const double below = (y * s + x * t) * sinAlpha;
    const double q = below != 0.0 ? glm::clamp(((y * t - x * s) * cosAlpha - y) / below, -1.0, 1.0) : 1.0;
    const glm::dvec3 cut = q * a + std::sqrt(1.0 - q * q) * glm::normalize(c - glm::dot(c, a) * a);
    const double z = 1.0 - v * (1.0 - glm::dot(cut, b));
    return z * b + std::sqrt(std::max(0.0, 1.0 - z * z)) * glm::normalize(cut - glm::dot(cut, b) * b);
  }

 private:
  std::array<glm::dvec3, 3> corner_;          // unit, from the place
  double solidAngle_sr_ = 0.0, alpha_ = 0.0;  // alpha: the angle at the first corner
};

/// Weights of the second and third corner at a place of the triangle's plane, kept within it.
glm::dvec2 baryOf(const std::array<glm::dvec3, 3>& c, const glm::dvec3& at) {
  const glm::dvec3 e1 = c[1] - c[0], e2 = c[2] - c[0], d = at - c[0], n = glm::cross(e1, e2);
  const double n2 = glm::dot(n, n);
  glm::dvec2 b(glm::dot(glm::cross(d, e2), n) / n2, glm::dot(glm::cross(e1, d), n) / n2);
  b = glm::max(b, glm::dvec2(0.0));
  const double sum = b.x + b.y;
  return sum > 1.0 ? b / sum : b;
}

/// The least sphere about the places' middle.
Receivers around(std::span<const SurfacePoint> places) {
  glm::dvec3 lo = places[0].position_m, hi = lo;
  bool flat = true;
  for (const SurfacePoint& p : places) {
    lo = glm::min(lo, p.position_m);
    hi = glm::max(hi, p.position_m);
    flat = flat && p.normal == places[0].normal;
  }
  Receivers r{0.5 * (lo + hi), 0.0, flat ? places[0].normal : glm::dvec3(0.0), 0.0};
  for (const SurfacePoint& p : places) r.radius_m = std::max(r.radius_m, glm::distance(r.centre_m, p.position_m));
  return r;
}

/// Of rays to a lamp from some of `places` places; those without a ray get nothing.
DirectPart meanOf(std::span<const glm::dvec3> unshadowed, std::span<const std::uint8_t> blocked, std::size_t places) {
  DirectPart out;
  std::size_t seen = 0;
  for (std::size_t i = 0; i < unshadowed.size(); ++i) {
    out.unshadowed += unshadowed[i] / double(places);
    if (blocked[i]) continue;
    ++seen;
    out.illuminance += unshadowed[i] / double(places);
  }
  out.seen = seen > 0;
  out.mixed = seen > 0 && seen < places;  // the edge of a cone or of the light's side counts as an edge, too
  return out;
}

}  // namespace

DirectLight::DirectLight(const Scene& scene, const Tracer& tracer, bool shadows)
    : scene_(scene),
      tracer_(tracer),
      shadows_(shadows),
      emitters_(findEmitters(scene, kMaxEmitterPieces)),
      tree_(scene, emitters_),
      rays_(scene.lights.size()) {}

namespace {
thread_local DirectLight::Tally* tally = nullptr;
}

DirectLight::Tally::Tally(const DirectLight& light) : rays(light.rays_.size(), 0) { tally = this; }
DirectLight::Tally::~Tally() { tally = nullptr; }

void DirectLight::countRays(std::uint32_t light, std::uint64_t rays) const {
  rays_[light].fetch_add(rays, std::memory_order_relaxed);
  if (tally) tally->rays[light] += rays;
}

void DirectLight::countAsCast(std::span<const std::uint64_t> rays) const {
  for (std::size_t i = 0; i < rays.size(); ++i) rays_[i].fetch_add(rays[i], std::memory_order_relaxed);
}

DirectPart DirectLight::sample(std::span<const SurfacePoint> places, const LightCut& cut, const Sobol4& address) const {
  DirectPart out;
  for (const std::uint32_t light : cut.punctual) out += punctual(places, light);
  if (!cut.emitters.empty()) out += emitters(places, cut.emitters, address);
  if (!cut.groups.empty()) out += groups(places, groupsAt(cut, around(places)), std::max(2 * places.size(), kLeastDraws), address);
  return out;
}

void DirectLight::trace(std::span<const Ray> rays, std::span<std::uint8_t> blocked, Purpose purpose) const {
  if (shadows_)
    tracer_.occluded(rays, blocked, purpose);
  else
    std::ranges::fill(blocked, std::uint8_t(0));
}

Ray DirectLight::towards(const Light& light, const SurfacePoint& p, const glm::dvec3& towards, bool endless) const {
  const glm::vec3 from = tracer_.lifted(p.position_m, p.geometricNormal);
  if (endless) return {from, glm::vec3(towards), INFINITY};
  // The ray ends a little before the lamp: one that lies in a surface, or touches it, is not hidden by it.
  const glm::dvec3 way = light.position_m - glm::dvec3(from);
  return {from, glm::vec3(way), float(std::max(0.0, 1.0 - 2.0 * double(tracer_.lift_m()) / glm::length(way)))};
}

DirectPart DirectLight::punctual(std::span<const SurfacePoint> places, std::uint32_t index) const {
  assert(places.size() <= kMaxPlaces);
  DirectPart out;
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
    rays[n++] = towards(light, p, in.towards, in.endless);
  }
  if (n == 0) return out;
  trace({rays.data(), n}, {blocked.data(), n}, Purpose::Shadow);
  if (shadows_) countRays(index, n);
  return meanOf({unshadowed.data(), n}, {blocked.data(), n}, places.size());
}

bool DirectLight::isNearby(std::uint32_t index, const glm::dvec3& place_m, double diameter_m) const {
  const Light& light = scene_.lights[index];
  if (light.kind == Light::Kind::Directional) return false;
  // A constant that outweighs the rest within a texel has no pole.
  if (light.classic && light.classic->constant >= light.classic->quadratic * diameter_m * diameter_m) return false;
  return glm::distance(light.position_m, place_m) < kNearbyTexel * diameter_m;
}

// E = sum over pieces of share/A int K V dA, and dA = d^2/cos dw about the light: E = sum of share/A int K V d^2/cos dw. K d^2/cos is the
// intensity times ratios of cosines, without a pole. Pieces are chosen by share/A times their solid angle.
DirectPart DirectLight::punctualNearby(std::span<const TexelPiece> pieces, std::uint32_t index, std::uint32_t count,
                                       const Sobol4& address) const {
  assert(count <= kMaxPlaces);
  const Light& light = scene_.lights[index];
  struct Seen {
    SphericalTriangle cone;
    std::array<glm::dvec3, 3> corner_m;
    glm::dvec3 normal;
    const TexelPiece* piece;
    double weight;
  };
  std::vector<Seen> seenPieces;
  double all = 0.0;
  for (const TexelPiece& piece : pieces) {
    const auto c = scene_.corners_m(piece.triangle);
    std::array<glm::dvec3, 3> corner;
    for (std::size_t k = 0; k < 3; ++k) corner[k] = c[0] + piece.bary[k].x * (c[1] - c[0]) + piece.bary[k].y * (c[2] - c[0]);
    const double area = area_m2(corner);
    const glm::dvec3 n = glm::cross(c[1] - c[0], c[2] - c[0]);
    if (!(area > 0.0) || !(glm::dot(light.position_m - corner[0], n) > 0.0)) continue;
    const SphericalTriangle cone(light.position_m, corner);
    if (!(cone.solidAngle_sr() > kLeastSolidAngle_sr * kLeastSolidAngle_sr)) continue;
    seenPieces.push_back({cone, corner, glm::normalize(n), &piece, piece.share / area * cone.solidAngle_sr()});
    all += seenPieces.back().weight;
  }
  DirectPart out;
  if (seenPieces.empty()) return out;
  std::array<Ray, kMaxPlaces> rays;
  std::array<glm::dvec3, kMaxPlaces> unshadowed;
  std::array<std::uint8_t, kMaxPlaces> blocked;
  std::size_t n = 0;
  for (std::uint32_t k = 0; k < count; ++k) {
    const glm::vec4 u = address.point(k);
    double target = double(u.z) * all;
    const Seen* chosen = &seenPieces.back();
    for (const Seen& s : seenPieces) {
      if (target < s.weight) {
        chosen = &s;
        break;
      }
      target -= s.weight;
    }
    const double left = std::clamp(target / chosen->weight, 0.0, 1.0);  // of the random number that chose, used again
    const glm::dvec3 way = chosen->cone.direction(left, double(u.w));
    const double slope = glm::dot(way, chosen->normal);
    if (!(slope < 0.0)) continue;
    const glm::dvec3 at = light.position_m + glm::dot(chosen->corner_m[0] - light.position_m, chosen->normal) / slope * way;
    const SurfacePoint p = surfacePoint(scene_, chosen->piece->triangle, baryOf(scene_.corners_m(chosen->piece->triangle), at));
    const Incoming in = incoming(light, p.position_m, p.normal);
    if (in.illuminance == glm::dvec3(0.0)) continue;
    const double d2 = glm::dot(in.towards, in.towards);
    unshadowed[n] = in.illuminance * (all * d2 / -slope);
    rays[n++] = towards(light, p, in.towards, in.endless);
  }
  if (n == 0) return out;
  trace({rays.data(), n}, {blocked.data(), n}, Purpose::Shadow);
  if (shadows_) countRays(index, n);
  return meanOf({unshadowed.data(), n}, {blocked.data(), n}, count);
}

DirectPart DirectLight::emitters(std::span<const SurfacePoint> places, std::span<const std::uint32_t> emitters,
                                 const Sobol4& address) const {
  DirectPart out;
  // A place on the lamp or in its plane gets nothing from it; rounding must not say otherwise.
  const double inPlane_m = double(tracer_.lift_m());
  const auto inFront = [&](const SurfacePoint& p, const Emitter& e) {
    return p.triangle != e.triangle && glm::dot(p.position_m - e.corner_m[0], e.normal) > inPlane_m;
  };

  // E without blockers, closed form, mean over a few of the places.
  glm::dvec3 unoccluded(0.0);
  const std::size_t closed = std::min(kClosedFormPlaces, places.size());
  thread_local std::vector<std::uint32_t> shining;
  shining.clear();
  for (const std::uint32_t id : emitters) {
    const Emitter& e = emitters_.whole[id];
    double factor = 0.0;
    for (std::size_t i = 0; i < closed; ++i)
      if (inFront(places[i], e)) factor += unoccludedFactor(places[i], e) / double(closed);
    if (factor > 0.0) shining.push_back(id);
    unoccluded += kPi * factor * glm::dvec3(e.radiance);
  }
  if (unoccluded == glm::dvec3(0.0)) return out;

  // The choice of pieces: by what they would give to the first place (disc form) as a share of each channel, so that the only blue lamp
  // among many red ones is not forgotten, and a little by power alone.
  struct Candidate {
    const Emitter* piece;
    double factor, begin;
  };
  thread_local std::vector<Candidate> pieces;
  pieces.clear();
  glm::dvec3 given(0.0), power(0.0);
  for (const std::uint32_t id : shining)
    for (std::uint32_t k = 0; k < emitters_.whole[id].pieceCount; ++k) {
      const Emitter& e = emitters_.pieces[emitters_.whole[id].firstPiece + k];
      if (!inFront(places[0], e)) continue;
      const glm::dvec3 centre = (e.corner_m[0] + e.corner_m[1] + e.corner_m[2]) / 3.0;
      pieces.push_back({&e, elementToDisc(places[0].position_m, places[0].normal, centre, e.normal, e.area_m2), 0.0});
      given += pieces.back().factor * glm::dvec3(e.radiance);
      power += e.area_m2 * glm::dvec3(e.radiance);
    }
  const auto weights = [](const glm::dvec3& whole) {
    return glm::dvec3(whole.x > 0.0 ? 1.0 / whole.x : 0.0, whole.y > 0.0 ? 1.0 / whole.y : 0.0, whole.z > 0.0 ? 1.0 / whole.z : 0.0);
  };
  const glm::dvec3 byGiven = (1.0 - kDefensive) * weights(given), byPower = kDefensive * weights(power);
  double total = 0.0;
  for (Candidate& c : pieces) {
    c.begin = total;
    total += glm::dot(glm::dvec3(c.piece->radiance), c.factor * byGiven + c.piece->area_m2 * byPower);
  }
  if (!(total > 0.0)) return out;

  std::array<Ray, kMaxPlaces> rays;
  std::array<glm::dvec3, kMaxPlaces> radiance,
      mean;  // times kernel over density: what counts when seen, and what would count if nothing were in the way
  std::array<std::uint8_t, kMaxPlaces> blocked;
  std::size_t n = 0;
  // A ratio of few terms says little: a single place draws several.
  for (std::size_t i = 0; i < std::max(places.size(), kLeastDraws); ++i) {
    const SurfacePoint& p = places[i % places.size()];
    const glm::vec2 u = address.point2(std::uint32_t(i));
    const double pick = double(u.x) * total;
    const std::size_t chosen = std::size_t(std::ranges::upper_bound(pieces, pick, {}, &Candidate::begin) - pieces.begin()) - 1;
    const Emitter& emitter = *pieces[chosen].piece;
    const double share = (chosen + 1 < pieces.size() ? pieces[chosen + 1].begin : total) - pieces[chosen].begin;
    if (!(share > 0.0)) continue;
    const double s = std::sqrt(std::clamp((pick - pieces[chosen].begin) / share, 0.0, 1.0));
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
  if (n == 0) return out;
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
  out.unshadowed = unoccluded;
  out.seen = seen > 0;
  out.mixed = seen > 0 && seen < n;
  return out;
}

DirectPart DirectLight::groups(std::span<const SurfacePoint> places, const LightTree::Groups& lights, std::size_t draws,
                               const Sobol4& address) const {
  DirectPart out;
  std::array<Ray, kMaxPlaces> rays;
  std::array<glm::dvec3, kMaxPlaces> unshadowed;
  std::array<std::uint8_t, kMaxPlaces> blocked;
  std::size_t n = 0, cast = 0, seen = 0;
  const auto flush = [&] {
    if (n == 0) return;
    trace({rays.data(), n}, {blocked.data(), n}, Purpose::Emitter);
    for (std::size_t i = 0; i < n; ++i) {
      out.unshadowed += unshadowed[i] / double(draws);
      if (blocked[i]) continue;
      ++seen;
      out.illuminance += unshadowed[i] / double(draws);
    }
    cast += n;
    n = 0;
  };
  // In the order of the lights that are chosen, so that what is near each other in the level is asked for one after the other: of 2^m
  // points of a scrambled Sobol sequence each lies in a stratum of its own.
  struct Numbers {
    glm::vec2 u;
    std::uint32_t index;
  };
  thread_local std::vector<Numbers> numbers;
  numbers.resize(draws);
  const bool stratified = std::has_single_bit(draws);
  for (std::uint32_t i = 0; i < draws; ++i) {
    const glm::vec2 u = address.point2(i);
    numbers[stratified ? std::size_t(u.x * float(draws)) : std::size_t(i)] = {u, i};
  }
  std::size_t group = 0;
  for (const auto& [u, i] : numbers) {
    const SurfacePoint& p = places[i % places.size()];
    double pick = double(u.x);
    const LightTree::Choice choice = lights.choose(p, pick, group);
    if (!(choice.share > 0.0)) continue;
    if (choice.light < tree_.punctualCount()) {
      const Light& light = scene_.lights[choice.light];
      const Incoming in = incoming(light, p.position_m, p.normal);
      if (in.illuminance == glm::dvec3(0.0) || glm::dot(in.towards, p.geometricNormal) <= 0.0) continue;
      unshadowed[n] = in.illuminance / choice.share;
      rays[n++] = towards(light, p, in.towards, in.endless);
      if (shadows_) countRays(choice.light, 1);
    } else {
      const Emitter& e = emitters_.whole[choice.light - tree_.punctualCount()];
      if (p.triangle == e.triangle || glm::dot(p.position_m - e.corner_m[0], e.normal) <= double(tracer_.lift_m())) continue;
      glm::dvec3 q;
      double kernel = 0.0;  // what a radiance of 1 gives [sr]
      const std::optional<SphericalTriangle> seenAs =
          isNear(p, e) ? std::optional<SphericalTriangle>({p.position_m, e.corner_m}) : std::nullopt;
      if (seenAs && seenAs->solidAngle_sr() > kLeastSolidAngle_sr) {
        const glm::dvec3 way = seenAs->direction(pick, double(u.y));
        q = p.position_m + glm::dot(e.corner_m[0] - p.position_m, e.normal) / glm::dot(way, e.normal) * way;
        kernel = seenAs->solidAngle_sr() * glm::dot(way, p.normal);
      } else {
        const double s = std::sqrt(pick), w1 = s * (1.0 - double(u.y)), w2 = s * double(u.y);
        q = e.corner_m[0] + w1 * (e.corner_m[1] - e.corner_m[0]) + w2 * (e.corner_m[2] - e.corner_m[0]);
        const glm::dvec3 r = q - p.position_m;
        const double d2 = glm::dot(r, r);
        kernel = std::max(0.0, glm::dot(r, p.normal)) * std::max(0.0, -glm::dot(r, e.normal)) / (d2 * d2) * e.area_m2;
      }
      if (!(kernel > 0.0) || !std::isfinite(kernel) || glm::dot(q - p.position_m, p.geometricNormal) <= 0.0) continue;
      unshadowed[n] = kernel / choice.share * glm::dvec3(e.radiance);
      const glm::vec3 from = tracer_.lifted(p.position_m, p.geometricNormal), to = tracer_.lifted(q, e.normal);
      rays[n++] = {from, to - from, 1.0f};
    }
    if (n == kMaxPlaces) flush();
  }
  flush();
  out.seen = seen > 0;
  out.mixed = seen > 0 && seen < cast;
  return out;
}

}  // namespace lmc
