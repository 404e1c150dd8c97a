#include "libradiosity/shoot.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "libscene/parallel.h"
#include "libscene/sampling.h"
#include "libscene/texture.h"

namespace lmc {

namespace {

constexpr double kLeastRaysPerPatch = 16.0;
constexpr double kLeastRaysOfShooter = 4.0;  // a patch with less to send waits until it has more
constexpr std::uint32_t kBackFace = kNone - 1, kLeft = kNone;
constexpr std::size_t kRaysAtOnce = 1 << 20;  // hits kept between tracing (parallel) and adding up (in order)
constexpr double kNothing = 1e-9;             // of the first power: passes end here whatever the bound says
constexpr int kHoleTries = 8;
constexpr std::uint32_t kBurialTries = 16;

struct Shooter {
  std::uint32_t patch;
  std::uint32_t rays;
  std::uint64_t firstRay;
};

std::uint32_t target(const PatchMesh& mesh, const Hit& hit) {
  if (!hit) return kLeft;
  const std::uint32_t patch = mesh.patchAt(hit.triangle, hit.bary, hit.front);
  return patch == kNone ? kBackFace : patch;
}

double strengthOf(const glm::dvec3& c) { return std::max({c.x, c.y, c.z}); }

/// A ray from the patch, cosine-distributed about its face. The index moves on past holes of Mask materials.
Ray leaving(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const Patch& patch, const Sobol4& numbers, std::uint32_t index,
            std::uint32_t stride) {
  for (int attempt = 0;; ++attempt) {
    const glm::vec4 u = numbers.point(index);
    const auto [triangle, bary] = mesh.sample(patch, {u.z, u.w});
    const Material& m = scene.materialOf(triangle);
    if (m.alpha == Material::Alpha::Mask && attempt < kHoleTries && alphaAt(scene, triangle, glm::vec2(bary)) < m.alphaCutoff) {
      index += stride;
      continue;
    }
    const SurfacePoint p = surfacePoint(scene, triangle, bary);
    const glm::dvec3 n = patch.back ? -p.geometricNormal : p.geometricNormal;
    return {tracer.lifted(p.position_m, n), glm::vec3(frameAbout(n) * cosineHemisphere({u.x, u.y})), INFINITY};
  }
}

}  // namespace

double Energy::imbalance() const {
  const glm::dvec3 out = absorbed + backs + left + unsent;
  double worst = 0.0;
  for (int c = 0; c < 3; ++c)
    if (!std::isfinite(sent[c] + out[c]))
      return std::numeric_limits<double>::infinity();
    else if (sent[c] > 0.0)
      worst = std::max(worst, std::abs(out[c] - sent[c]) / sent[c]);
  return worst;
}

Solution shoot(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const PatchLight& light, const ShootOptions& options,
               const Run& run) {
  const std::size_t n = mesh.patches.size();
  std::vector<glm::dvec3> unsent(n), arrived(n, glm::dvec3(0.0)), incoming(n);
  Solution out;
  double largestRho = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const Patch& p = mesh.patches[i];
    unsent[i] = p.area_m2 * glm::dvec3(p.reflectance) * glm::dvec3(light.direct[i] + light.sky[i]);
    out.energy.sent += unsent[i];
    largestRho = std::max(largestRho, strengthOf(glm::dvec3(p.reflectance)));
  }
  double first = 0.0;
  for (const glm::dvec3& u : unsent) first += strengthOf(u);
  const auto illuminance = [&] {
    Bounced h(n);
    for (std::size_t i = 0; i < n; ++i) h[i] = mesh.patches[i].area_m2 > 0.0 ? Rgb(arrived[i] / mesh.patches[i].area_m2) : Rgb(0.0f);
    return h;
  };

  double exitance = first;  // power that leaves all surfaces, sent or not
  const auto tailOf = [&](double unsentPower, double rho) { return unsentPower * rho / std::max(1e-6, 1.0 - rho) / exitance; };
  std::vector<std::uint32_t> hits;
  std::vector<Shooter> shooters;
  double left = first, before = first;
  while (first > 0.0) {
    if (tailOf(left, largestRho) <= options.maxTail || left <= kNothing * first) {
      out.stop = Stop::Energy;
      break;
    }
    if (options.maxPasses >= 0 && out.passes >= options.maxPasses) {
      out.stop = Stop::Passes;
      break;
    }
    const double rays = std::max(options.raysPerPatch * double(n) * left / first, kLeastRaysPerPatch * double(n));
    const double quantum = left / rays;
    shooters.clear();
    for (std::uint32_t i = 0; i < n; ++i) {
      const double wish = std::min(strengthOf(unsent[i]) / quantum, double(kRaysAtOnce));
      if (wish >= kLeastRaysOfShooter) shooters.push_back({i, std::uint32_t(wish), 0});
    }
    std::fill(incoming.begin(), incoming.end(), glm::dvec3(0.0));
    for (std::size_t begin = 0; begin < shooters.size();) {
      std::size_t end = begin;
      std::uint64_t count = 0;
      while (end < shooters.size() && (end == begin || count + shooters[end].rays <= kRaysAtOnce)) {
        shooters[end].firstRay = count;
        count += shooters[end++].rays;
      }
      hits.resize(std::size_t(count));
      const Run quiet = run.quiet();
      parallelFor(quiet, end - begin, 16, [&](std::size_t k) {
        const Shooter& s = shooters[begin + k];
        const Sobol4 numbers = sequence(run.seed, Draw::Shoot, options.stream, std::uint32_t(out.passes), s.patch, 0, 0);
        std::array<Ray, 256> batch;
        std::array<Hit, 256> met;
        for (std::uint32_t r = 0; r < s.rays; r += 256) {
          const std::uint32_t m = std::min(256u, s.rays - r);
          for (std::uint32_t q = 0; q < m; ++q) batch[q] = leaving(scene, tracer, mesh, mesh.patches[s.patch], numbers, r + q, s.rays);
          tracer.closest({batch.data(), m}, {met.data(), m}, Purpose::Shoot);
          for (std::uint32_t q = 0; q < m; ++q) {
            std::uint32_t to = target(mesh, met[q]);
            // From the buried part of a patch: start anew elsewhere on it.
            for (std::uint32_t attempt = 1; to == kBackFace && mesh.patches[s.patch].exposed != 0xffff && attempt <= kBurialTries;
                 ++attempt)
              to = target(mesh,
                          tracer.closest(leaving(scene, tracer, mesh, mesh.patches[s.patch], numbers, attempt * s.rays + r + q, s.rays),
                                         Purpose::Shoot));
            hits[std::size_t(s.firstRay) + r + q] = to;
          }
        }
      });
      // In order, so that sums have the same bits for any number of threads.
      for (std::size_t k = begin; k < end; ++k) {
        const Shooter& s = shooters[k];
        const glm::dvec3 each = unsent[s.patch] / double(s.rays);
        unsent[s.patch] = glm::dvec3(0.0);
        for (std::uint32_t r = 0; r < s.rays; ++r) {
          const std::uint32_t to = hits[std::size_t(s.firstRay) + r];
          if (to == kLeft)
            out.energy.left += each;
          else if (to == kBackFace)
            out.energy.backs += each;
          else
            incoming[to] += each;
        }
      }
      begin = end;
    }
    before = left;
    left = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      arrived[i] += incoming[i];
      unsent[i] += glm::dvec3(mesh.patches[i].reflectance) * incoming[i];
      exitance += strengthOf(glm::dvec3(mesh.patches[i].reflectance) * incoming[i]);
      left += strengthOf(unsent[i]);
    }
    ++out.passes;
    if (options.onPass) options.onPass(out.passes, illuminance());
    // Passes fall by a steady factor: progress by the logarithm of what is left.
    run.progress(std::clamp(std::log(left / first) / std::log(std::max(kNothing, options.maxTail * (1.0 - largestRho))), 0.0, 1.0));
  }
  out.illuminance = illuminance();
  double reflectance = 0.0, area = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const glm::dvec3 rho(mesh.patches[i].reflectance);
    out.energy.absorbed += (1.0 - rho) * arrived[i];
    out.energy.unsent += unsent[i];
    reflectance += mesh.patches[i].area_m2 * strengthOf(rho);
    area += mesh.patches[i].area_m2;
  }
  if (first > 0.0) {
    out.tail = tailOf(left, largestRho);
    out.tailEstimate = std::min(out.tail, tailOf(left, out.passes > 0 ? std::min(left / before, largestRho) : reflectance / area));
  }
  return out;
}

}  // namespace lmc
