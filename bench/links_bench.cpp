/// What the solvers by links and by stored rays cost and how far their fields are from a long run of shooting.
/// usage: links_bench LEVEL.glb|hall [--squares N] [--goal G] [--max-links N] [--partition LIST] [--reference RAYS_PER_PATCH] [--shoot]
/// [--no-links] `hall` is a made room with columns. Errors: of the patches' illuminance (area RMS over the mean, direct light included),
/// and of what hemisphere rays bring to places on the patches (same rays for both, so that no noise of their own is in it).
#include <fmt/format.h>

#include <cstdio>
#include <cstring>

#include "libradiosity/solve.h"
#include "libradiosity/solve_links.h"
#include "libradiosity/solve_stored.h"
#include "libscene/level.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"
#include "libscene/sampling.h"
#include "libscene/texels.h"
#include "lmc/progress.h"
#include "tests/support/scenes.h"

namespace {

using namespace lmc;

Scene hall() {
  test::SceneBuilder s(64);
  const auto white = s.material(Rgb(0.7f, 0.68f, 0.6f)), red = s.material(Rgb(0.6f, 0.2f, 0.15f)), lamp = s.material(Rgb(0.0f), Rgb(8.0f));
  s.room({0, 0, 0}, {24, 5, 16}, {white, red, white, white, white, white});
  for (int x = 0; x < 5; ++x)
    for (int z = 0; z < 3; ++z) {
      const glm::vec3 lo(3.7f + 4.0f * float(x), 0, 3.7f + 4.0f * float(z)), d(0.6f, 5, 0.6f);
      const glm::vec3 X(d.x, 0, 0), Y(0, d.y, 0), Z(0, 0, d.z);
      s.quad(lo, Z, Y, white);
      s.quad(lo + X, Y, Z, white);
      s.quad(lo, Y, X, white);
      s.quad(lo + Z, X, Y, white);
    }
  s.quad({8, 4.9f, 6}, {2, 0, 0}, {0, 0, 2}, lamp);
  return s.scene;
}

double since(double start) { return cpuSeconds() - start; }

}  // namespace

int main(int argc, char** argv) {
  std::string level = argc > 1 ? argv[1] : "hall", partition = "auto";
  double squares = 3000.0, goal = 0.02, reference = 0.0;
  std::uint64_t maxLinks = HierarchicalOptions{}.maxLinks;
  bool shooting = false, links = true;
  for (int i = 2; i < argc; ++i) {
    const std::string a = argv[i];
    const auto value = [&] { return i + 1 < argc ? std::string(argv[++i]) : std::string("0"); };
    if (a == "--squares") squares = std::stod(value());
    if (a == "--goal") goal = std::stod(value());
    if (a == "--max-links") maxLinks = std::stoull(value());
    if (a == "--partition") partition = value();
    if (a == "--reference") reference = std::stod(value());
    if (a == "--shoot") shooting = true;
    if (a == "--no-links") links = false;
  }
  const lmc::Run run;
  const Scene scene = level == "hall" ? hall() : loadLevel(level, {}, run);
  const Tracer tracer(scene);
  const DirectLight direct(scene, tracer, true);
  PatchMesh mesh = makePatches(scene, {.size_m = patchSizeFor_m(scene, squares), .maxPatches = 4'000'000}, run);
  exposePatches(mesh, scene, tracer, run);
  const PatchLight light = lightPatches(scene, tracer, mesh, direct, {}, run);
  const std::size_t n = mesh.patches.size();

  HierarchicalOptions options;
  options.goal = goal;
  options.maxTail = 0.05 * goal;
  options.maxLinks = maxLinks;
  if (partition != "auto") {
    options.partition.automatic = false;
    for (std::size_t r = 0; r < kRules; ++r)
      options.partition.on[r] = partition == "all" || partition.find(kRuleNames[r]) != std::string::npos;
  }
  std::uint64_t rays = tracer.rays(Purpose::Visibility);
  double start = cpuSeconds();
  HierarchicalSolution s;
  if (links) {
    s = solveHierarchical(scene, tracer, mesh, light, options, run);
    const double seconds = since(start);
    fmt::print(
        "{} patches, {:.3f} CPU s, {} links ({:.1f} a patch), {} pairs, {} rays, {} bytes ({:.1f} a link), rounds {}, iterations {}\n", n,
        seconds, s.stats.links, double(s.stats.links) / double(n), s.stats.pairs, tracer.rays(Purpose::Visibility) - rays, s.stats.bytes,
        double(s.stats.bytes) / double(std::max<std::uint64_t>(1, s.stats.links)), s.stats.rounds, s.fine.passes);
    fmt::print(
        "  link error {:.4f} (predicted {:.4f}), closure off by {:.4f}, tail {:.2g}, balance {:.2g}, threshold {:.3g}{}, "
        "peak {} MB\n",
        s.linkError, s.stats.predictedError, s.closureError, s.fine.tail, s.fine.energy.imbalance(), s.stats.threshold,
        s.stats.linksFull ? " (links full)" : "", peakBytes() >> 20);
    for (std::size_t r = 0; r < kRules; ++r) {
      const RuleCount& c = s.stats.rules[r];
      fmt::print("  {:8} {:4} asked {:9} settled {:9} rays saved {:9} {:.3f} s\n", kRuleNames[r], c.on ? "on" : "off", c.asked, c.settled,
                 c.raysSaved, c.seconds);
    }
  }

  Bounced exact;
  if (reference > 0.0)
    exact = shoot(scene, tracer, mesh, light, {.maxTail = 1e-4, .raysPerPatch = reference, .stream = 7, .onPass = {}}, run).illuminance;
  const auto compare = [&](const char* name, const Bounced& H) {
    double squaresSum = 0.0, mean = 0.0, area = 0.0, bias = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const Patch& p = mesh.patches[i];
      const glm::dvec3 d = glm::dvec3(H[i]) - glm::dvec3(exact[i]);
      squaresSum += p.area_m2 * glm::dot(d, d) / 3.0;
      bias += p.area_m2 * (d.x + d.y + d.z) / 3.0;
      const glm::dvec3 e = glm::dvec3(exact[i]) + glm::dvec3(light.direct[i]) + glm::dvec3(light.sky[i]);
      mean += p.area_m2 * (e.x + e.y + e.z) / 3.0;
      area += p.area_m2;
    }
    // Hemisphere rays from places on 2000 patches, by area.
    double seenSquares = 0.0, seenMean = 0.0, localSquares = 0.0;
    constexpr std::uint32_t kFrom = 2000, kRays = 256;
    double at = 0.0, before = 0.0;
    std::size_t i = 0;
    for (std::uint32_t k = 0; k < kFrom; ++k) {
      at = (k + 0.5) / kFrom * area;
      while (i + 1 < n && before + mesh.patches[i].area_m2 < at) before += mesh.patches[i++].area_m2;
      const Patch& p = mesh.patches[i];
      const Sobol4 numbers = sequence(3, Draw::Closure, 0, 0, k, 0, 0);
      std::array<Ray, kRays> cast;
      std::array<Hit, kRays> hits;
      for (std::uint32_t r = 0; r < kRays; ++r) {
        const glm::vec4 u = numbers.point(r);
        const auto [t, bary] = mesh.sample(p, {u.z, u.w});
        const SurfacePoint q = surfacePoint(scene, t, bary);
        const glm::dvec3 normal = p.back ? -q.geometricNormal : q.geometricNormal;
        cast[r] = {tracer.lifted(q.position_m, normal), glm::vec3(frameAbout(normal) * cosineHemisphere({u.x, u.y})), INFINITY};
      }
      tracer.closest(cast, hits, Purpose::Gather);
      glm::dvec3 sum(0.0), here(0.0);
      for (const Hit& h : hits) {
        if (!h) continue;
        const std::uint32_t id = mesh.patchAt(h.triangle, h.bary, h.front);
        if (id == kNone) continue;
        sum += glm::dvec3(mesh.patches[id].reflectance) * (glm::dvec3(H[id]) - glm::dvec3(exact[id])) / double(kRays);
      }
      here = glm::dvec3(exact[i]) + glm::dvec3(light.direct[i]) + glm::dvec3(light.sky[i]);
      seenSquares += glm::dot(sum, sum) / 3.0;
      localSquares += glm::dot(sum, sum) / std::max(1e-300, glm::dot(here, here));
      seenMean += (here.x + here.y + here.z) / 3.0;
    }
    fmt::print("  {:12} patches off by {:.3f} % RMS (bias {:+.3f} %), what rays see by {:.3f} % of the mean, {:.3f} % of the place\n", name,
               100.0 * std::sqrt(squaresSum / area) / (mean / area), 100.0 * bias / mean,
               100.0 * std::sqrt(seenSquares / kFrom) / (seenMean / kFrom), 100.0 * std::sqrt(localSquares / kFrom));
  };
  if (reference > 0.0) {
    if (links) {
      compare("links", s.fine.illuminance);
      compare("links before", s.coarse);
    }
  }
  if (std::getenv("DENSE") != nullptr && n <= kMaxDensePatches) {
    const FormFactors f = computeFormFactors(scene, tracer, mesh, run);
    fmt::print("  dense: closure off by {:.4f}\n", f.closureError);
    compare("dense", solveDense(mesh, f, light, {}).illuminance);
  }
  for (const std::uint32_t r : {32u}) {
    rays = tracer.rays(Purpose::Shoot);
    start = cpuSeconds();
    const StoredSolution t = solveStored(scene, tracer, mesh, light, {.rays = r, .maxTail = 0.05 * goal}, run);
    fmt::print("  stored rays {}: {:.3f} CPU s, {} rays, {} iterations, closure off by {:.3f}, balance {:.2g}, {} bytes, peak {} MB\n", r,
               since(start), tracer.rays(Purpose::Shoot) - rays, t.solution.passes, t.closureError, t.solution.energy.imbalance(), t.bytes,
               peakBytes() >> 20);
    if (reference > 0.0) compare("stored", t.solution.illuminance);
  }
  if (shooting) {
    rays = tracer.rays(Purpose::Shoot);
    start = cpuSeconds();
    const Solution shot = shoot(scene, tracer, mesh, light, {.maxTail = 0.05 * goal, .onPass = {}}, run);
    fmt::print("  shooting (one stream) {:.3f} CPU s, {} rays, {} passes\n", since(start), tracer.rays(Purpose::Shoot) - rays, shot.passes);
    if (reference > 0.0) compare("shooting", shot.illuminance);
  }
  return 0;
}
