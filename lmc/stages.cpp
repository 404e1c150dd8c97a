#include "lmc/stages.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "libradiosity/adaptive_patches.h"
#include "libradiosity/slopes.h"
#include "libscene/exr.h"
#include "libscene/files.h"
#include "libscene/journal.h"
#include "libscene/parallel.h"
#include "libscene/texture.h"
#include "lmc/ao.h"
#include "lmc/explain.h"
#include "lmc/pilot.h"

namespace lmc {

namespace {

// Patches are that much larger where direct light and albedo are even, and halved so often where they are not: half of the number, and the
// same error, of patches of one size.
constexpr double kCoarsePatch = 2.0;
constexpr std::uint8_t kPatchLevels = 2;
constexpr std::size_t kDenseByItself = 100;    // faces of patches: below it the dense solver costs less than stored rays, and has no noise
constexpr double kNearlyWhite = 0.95;          // area mean of reflectance from which shooting takes hundreds of passes: dense there
constexpr double kPatchesNearlyWhite = 400.0;  // squares; the field of such a level is smooth
constexpr std::size_t kDenseNearlyWhite = 1500;
constexpr double kTailShare = 0.05;  // of the goal, for bounces left out
constexpr int kLargestMap = 16384;
// Of the memory that may be held: from there on what can go goes. What comes in meanwhile, and what stacks take, has the rest.
constexpr double kHeldShare = 0.93;
constexpr double kWarnImbalance = 0.005, kFailImbalance = 0.05;

Plan planFor(const Bake& b) { return makePlan({b.options.effects, b.options.goal, b.options.passes > 0}, b.facts); }

}  // namespace

void load(Bake& b) {
  b.scene = loadLevel(b.options.level, b.options.limits, b.run);
  if (b.options.sky) b.scene.sky = *b.options.sky;
  b.summary = fmt::format("{} triangles, {} objects, {} lights", b.scene.triangles.size(), b.scene.objects.size(), b.scene.lights.size());
}

namespace {

// The strongest light beyond 2^+-40 of a unit is brought back to about 1: squares of it, and of what it makes at 1e6 times the distance,
// are then still floats.
constexpr int kOrdinaryLight = 40;

void chooseLightUnit(Bake& b) {
  float strongest = strength(b.scene.sky);
  for (const Light& l : b.scene.lights) strongest = std::max(strongest, strength(l.intensity));
  for (const Material& m : b.scene.materials) strongest = std::max(strongest, strength(m.emission));
  if (!(strongest > 0.0f) || std::abs(std::ilogb(strongest)) <= kOrdinaryLight) return;
  b.lightUnit = std::ldexp(1.0, std::ilogb(strongest));
  const auto inUnits = [&](Rgb& c) { c = Rgb(glm::dvec3(c) / b.lightUnit); };
  inUnits(b.scene.sky);
  for (Light& l : b.scene.lights) inUnits(l.intensity);
  for (Material& m : b.scene.materials) inUnits(m.emission);
}

void makeGrey(Scene& scene) {
  if (scene.grey) return;
  scene.grey = true;
  const auto byLuminance = [](Rgb& c) { c = Rgb(luminance(c)); };
  byLuminance(scene.sky);
  for (Light& l : scene.lights) byLuminance(l.intensity);
  for (Material& m : scene.materials)
    if (!m.emissionTexture) byLuminance(m.emission);
}

/// What does not run is not there for the stages that follow.
void dropWhatDoesNotRun(Bake& b) {
  if (!b.plan.runs(Effect::Direct)) b.scene.lights.clear();
  if (!b.plan.runs(Effect::Sky)) b.scene.sky = Rgb(0.0f);
  if (!b.plan.runs(Effect::Area))
    for (Material& m : b.scene.materials) m.emission = Rgb(0.0f);
  if (!b.plan.runs(Effect::Alpha))
    for (Material& m : b.scene.materials)
      if (m.alpha == Material::Alpha::Mask) m.alpha = Material::Alpha::Opaque;
  if (!b.plan.runs(Effect::Colour) && !b.facts.grey) makeGrey(b.scene);
}

}  // namespace

void plan(Bake& b) {
  chooseLightUnit(b);
  b.facts = factsOf(b.scene);
  b.plan = planFor(b);
  for (const Step& s : b.plan.steps)
    b.summary += fmt::format("{}{}{}", b.summary.empty() ? "" : " ", s.run ? "+" : "-", kEffectNames[std::size_t(s.effect)]);
  dropWhatDoesNotRun(b);
}

namespace {

/// Charts so small that other charts have the texels in which they lie.
void warnOfLostCharts(const Bake& b) {
  std::vector<bool> seen(b.charts.count, false);
  for (const std::uint32_t c : b.map.chart)
    if (c != kNone) seen[c] = true;
  const auto lost = std::ranges::count(seen, false);
  if (lost == 0) return;
  const auto first = std::uint32_t(std::ranges::find(seen, false) - seen.begin());
  const auto triangle = std::uint32_t(std::ranges::find(b.charts.chartOf, first) - b.charts.chartOf.begin());
  const Object& o = b.scene.objectOf(triangle);
  b.run.warn({{},
              b.scene.file.string(),
              fmt::format("/meshes/{}/primitives/{}/attributes/TEXCOORD_1", o.mesh, o.primitive),
              fmt::format("{} light-map charts are too small to get a texel of a map of {} x {}; the first is of object '{}'", lost,
                          b.uv.side, b.uv.side, o.path),
              "LMC_UV_TINY"});
}

}  // namespace

void reportUvs(const Bake& b) {
  const auto say = [&](ObjectUv::Fate fate, const char* what) {
    const auto is = [&](const ObjectUv& u) { return u.fate == fate; };
    const auto n = std::ranges::count_if(b.uv.objects, is);
    if (n == 0) return;
    const auto first = std::ranges::find_if(b.uv.objects, is);
    b.run.note({{},
                b.scene.file.string(),
                "",
                fmt::format("light-map UVs of {} objects {}; the first: {}", n, what, first->because),
                "LMC_UV_NEW"});
  };
  say(ObjectUv::Fate::Repaired, "are placed anew");
  say(ObjectUv::Fate::Made, "are made");
}

namespace {

/// For what memory is not to hold: where the outputs go, or where none do, where the system has its temporary files.
std::filesystem::path scratchFolder(const BakeOptions& o) {
  std::error_code error;
  if (std::filesystem::is_directory(o.out, error)) return o.out;
  const std::filesystem::path temporary = std::filesystem::temp_directory_path(error);
  return error ? std::filesystem::path(".") : temporary;
}

}  // namespace

void charts(Bake& b) {
  b.uv = layOut(b.scene, b.options.uv, b.run);
  const int side = b.uv.side;
  if (side > kLargestMap)
    throw Error(Exit::Limit, b.scene.file, "/scenes/0/extras/lmc/lightmap/resolution",
                fmt::format("a map of {} x {} is above the limit of {}", side, side, kLargestMap), "LMC_MAP_SIZE");
  reportUvs(b);
  b.memory = planMemory(b.scene, b.options, side, b.uv.maps, b.plan.runs(Effect::Bounce), b.plan.runs(Effect::Seams), memoryBytes());
  if (b.memory.least_bytes > b.memory.limit_bytes)
    throw Error(
        Exit::Limit, b.scene.file, "",
        fmt::format("{} of {} x {} {} --memory {} at least, and {} {}", b.uv.maps == 1 ? "a map" : fmt::format("{} maps", b.uv.maps), side,
                    side, b.uv.maps == 1 ? "takes" : "take", sizeText(b.memory.least_bytes),
                    b.options.memory_bytes > 0 ? "the limit is" : "this machine has", sizeText(b.memory.limit_bytes)),
        "LMC_MEMORY");
  if (b.memory.paged() && !b.paging)
    b.paging =
        std::make_shared<Paging>(scratchFolder(b.options), std::uint64_t(kHeldShare * double(b.memory.held_bytes)), threadCount(b.run));
  b.charts = findCharts(b.scene, side, b.run);
  b.texels = std::make_unique<TexelMap>(b.scene, b.charts, side, b.uv.maps);
  b.texels->keepAtMost(b.memory.tiles_bytes);
  b.map = startMap(b.scene, *b.texels, b.run);
  warnOfLostCharts(b);
  if (b.plan.runs(Effect::Seams)) {  // else somebody does not want them, and the search takes as much memory as the ray tracer
    b.seams = findSeams(b.scene);
    b.facts.smoothSeams = b.seams.smooth.size();
  }
  b.plan = planFor(b);  // what seams there are is known now
  const auto covered = std::size_t(std::ranges::count_if(b.map.chart, [](std::uint32_t c) { return c != kNone; }));
  b.summary = fmt::format("{}{} x {}, {} charts, {} texels covered", b.uv.maps == 1 ? "" : fmt::format("{} maps of ", b.uv.maps), side,
                          side, b.charts.count, covered);
}

void trace(Bake& b) {
  if (!b.plan.anything()) {
    b.summary = "nothing to trace";
    return;
  }
  b.tracer = std::make_unique<Tracer>(b.scene);
  b.summary = fmt::format("{:.1f} MB", double(b.tracer->bytes()) / 1e6);
  if (b.tracer->degenerateTriangles() > 0)
    b.run.note({{},
                b.scene.file.string(),
                "",
                fmt::format("{} triangles without area are left out", b.tracer->degenerateTriangles()),
                "LMC_DEGENERATE"});
}

void pilot(Bake& b) {
  if (!b.tracer) {
    b.summary = "nothing to foretell";
    return;
  }
  b.facts.pilot = runPilot(b);
  for (std::size_t p = 0; p < b.pilotRays.size(); ++p) b.pilotRays[p] = b.tracer->rays(Purpose(p));
  b.plan = planFor(b);
  dropWhatDoesNotRun(b);
  const Forecast all = forecastOf(b.plan, *b.facts.pilot);
  b.summary = fmt::format("{:.2g} CPU s foretold ({:.2g} to {:.2g}), {:.3g} M rays", all.cpu_s, all.least_s, all.most_s, all.rays / 1e6);
}

void directLight(Bake& b) {
  if (!b.tracer) return;
  b.direct = std::make_unique<DirectLight>(b.scene, *b.tracer, b.plan.runs(Effect::Shadow));
  if (!b.direct->any()) {
    b.summary = "no lights but the sky";
    return;
  }
  bakeDirect(b.map, b.scene, *b.texels, *b.direct, {b.options.goal}, b.run);
  b.summary = fmt::format("{} lights, {} emissive triangles", b.scene.lights.size(), b.direct->emitters().whole.size());
}

namespace {

double meanReflectance(const PatchMesh& mesh) {
  double sum = 0.0, area = 0.0;
  for (const Patch& p : mesh.patches) {
    sum += p.area_m2 * (double(p.reflectance.r) + double(p.reflectance.g) + double(p.reflectance.b)) / 3.0;
    area += p.area_m2;
  }
  return area > 0.0 ? sum / area : 0.0;
}

void clampReflectance(Bake& b) {
  std::uint32_t firstObject = kNone;
  for (Patch& p : b.patches.patches) {
    if (strength(p.reflectance) <= kMostReflectance) continue;
    b.clampedAway += p.area_m2 * double(strength(p.reflectance) - kMostReflectance);
    p.reflectance = glm::min(p.reflectance, Rgb(kMostReflectance));
    if (b.clampedPatches++ == 0) firstObject = p.object;
  }
  if (b.clampedPatches == 0) return;
  // What the clamp takes of each bounce, and of all that follow it.
  double area = 0.0;
  for (const Patch& p : b.patches.patches) area += p.area_m2;
  b.clampedAway /= area * (1.0 - std::min(double(kMostReflectance), b.meanReflectance));
  const Object& o = b.scene.objects[firstObject];
  b.run.warn({{},
              b.scene.file.string(),
              fmt::format("/materials/{}", o.material),
              fmt::format("albedo above {} is taken as {} on {} patches, the first of object '{}'", kMostReflectance, kMostReflectance,
                          b.clampedPatches, o.path),
              "LMC_ALBEDO_ONE"});
}

}  // namespace

void patches(Bake& b) {
  if (!b.plan.runs(Effect::Bounce)) {
    b.summary = "no bounces";
    return;
  }
  // Two halves of the direct map make one for what hits see.
  TexelArray<Rgb> mean(b.map.size());
  for (std::size_t i = 0; i < mean.size(); ++i) mean[i] = 0.5f * (b.map.direct[0][i] + b.map.direct[1][i]);
  b.values.direct = std::move(mean);
  const DirectMap seen{b.map.width, b.map.height, b.values.direct.data(), b.map.chart.data(), &b.charts, b.map.edge.data()};
  PatchOptions options;
  options.maxPatches = b.options.maxPatches;
  const double wanted = std::min(squaresFor(b.options.goal), double(options.maxPatches));
  options.size_m = b.options.patchSize_m > 0.0 ? b.options.patchSize_m : patchSizeFor_m(b.scene, wanted);
  if (b.options.patchSize_m > 0.0) {
    b.patches = makePatches(b.scene, options, b.run);
  } else {
    options.size_m *= kCoarsePatch;
    options.levels = kPatchLevels;
    b.patches = makeAdaptivePatches(b.scene, *b.tracer, *b.direct, seen, *b.texels, options, b.run);
  }
  b.meanReflectance = meanReflectance(b.patches);
  if (b.meanReflectance > kNearlyWhite && b.options.patchSize_m == 0.0 && b.options.solver == Solver::Auto && b.options.passes == 0)
    b.patches = makePatches(b.scene, {.size_m = patchSizeFor_m(b.scene, kPatchesNearlyWhite), .maxPatches = b.options.maxPatches}, b.run);
  clampReflectance(b);
  exposePatches(b.patches, b.scene, *b.tracer, b.run);
  b.patchLight = lightPatches(b.scene, *b.tracer, b.patches, *b.direct, seen, b.run, patchSkyRaysFor(b.options.goal));
  b.summary = fmt::format("{} patches of {:.3g} m, {} faces", b.patches.patches.size(), b.patches.size_m, b.patches.leaves.size());
}

namespace {

double maxTailOf(const BakeOptions& o) { return o.bounceTail > 0.0 ? o.bounceTail : kTailShare * o.goal; }

/// Passes and pictures of them are shooting's. Few patches, or nearly white ones, are dense's: exact, and soon done. For the rest stored
/// rays: the error of shooting at a fifth of its time; links need more than either for the same error (bench/links_bench).
Solver solverFor(const Bake& b) {
  if (b.options.passes > 0 || b.options.snapshot) return Solver::Shooting;
  if (b.options.solver != Solver::Auto) return b.options.solver;
  const bool dense =
      b.meanReflectance > kNearlyWhite ? b.patches.patches.size() <= kDenseNearlyWhite : b.patches.leaves.size() <= kDenseByItself;
  return dense ? Solver::Dense : Solver::Stored;
}

/// A solution that takes as long as its patches are many.
template <class Archive>
void keep(Solution& s, std::size_t patches, Archive& archive) {
  s.illuminance.resize(patches);
  for (Rgb& e : s.illuminance) archive(e);
  archive(s.energy);
  archive(s.stop);
  archive(s.passes);
  archive(s.tail);
  archive(s.tailEstimate);
}

void solveDensely(Bake& b) {
  const FormFactors f = computeFormFactors(b.scene, *b.tracer, b.patches, b.run);
  b.closureError = f.closureError;
  b.solutions[0] = solveDense(b.patches, f, b.patchLight, {});
  b.solutions[1] = b.solutions[0];
  b.summary = fmt::format("dense, {} iterations, closure was off by {:.2g}", b.solutions[0].passes, b.closureError);
}

void solveByStoredRays(Bake& b) {
  StoredOptions options;
  options.rays = storedRaysFor(b.options.goal, b.patches.patches.size());
  options.maxTail = maxTailOf(b.options);
  options.maxBytes = b.memory.rays_bytes;
  for (std::uint32_t half = 0; half < 2; ++half) {
    const Run part = b.run.part(0.5 * half, 0.5 * (half + 1));
    options.stream = half;
    StoredSolution s;
    Journaled kept(
        part, *b.tracer, {Loop::Solve, half, 0},
        [&](auto& archive) {
          keep(s.solution, b.patches.patches.size(), archive);
          archive(s.bytes);
          archive(s.closureError);
        },
        WorkOf::All);
    if (!kept.taken()) {
      s = solveStored(b.scene, *b.tracer, b.patches, b.patchLight, options, part);
      kept.put();
    }
    b.closureError = s.closureError;
    b.storedBytes += s.bytes;
    b.solutions[half] = std::move(s.solution);
  }
  b.summary = fmt::format("stored rays, 2 x {} a patch, {} iterations, tail at most {:.2g}", options.rays, b.solutions[0].passes, b.tail());
}

void solveByLinks(Bake& b) {
  HierarchicalOptions options;
  options.goal = b.options.goal;
  options.maxTail = maxTailOf(b.options);
  options.maxLinks = b.options.maxLinks;
  options.partition = b.options.partition;
  HierarchicalSolution s = solveHierarchical(b.scene, *b.tracer, b.patches, b.patchLight, options, b.run);
  b.links = s.stats;
  b.linkError = s.linkError;
  b.closureError = s.closureError;
  b.coarseSolution = std::move(s.coarse);
  b.solutions[0] = b.solutions[1] = std::move(s.fine);
  if (b.links.linksFull)
    b.run.note({{},
                b.scene.file.string(),
                "",
                fmt::format("--max-links {} kept the threshold of links up: they predict an error of {:.2g} %", b.options.maxLinks,
                            100.0 * b.links.predictedError),
                "LMC_LINKS_FULL"});
  b.summary = fmt::format("{} links in {} rounds, {} iterations, they change {:.2g} %", b.links.links, b.links.rounds,
                          b.solutions[0].passes, 100.0 * b.linkError);
}

void solveByShooting(Bake& b) {
  std::optional<TexelPatches> under;
  if (b.options.snapshot) under.emplace(b.scene, b.patches, *b.texels, b.run.silent());
  for (std::uint32_t half = 0; half < 2; ++half) {
    ShootOptions options;
    options.maxTail = maxTailOf(b.options);
    if (b.options.passes > 0) options.maxPasses = b.options.passes - 1;  // hemisphere rays add the last bounce
    options.stream = half;
    if (b.options.snapshot && half == 0)
      options.onPass = [&](int pass, const Bounced& bounced) {
        std::vector<Rgb> E(b.map.size(), Rgb(0.0f));
        for (std::size_t i = 0; i < E.size(); ++i)
          if (const std::uint32_t patch = under->patch[i]; b.map.chart[i] != kNone)
            E[i] = b.values.direct[i] + (patch == kNone ? Rgb(0.0f) : b.patchLight.sky[patch] + bounced[patch]);
        float largest = 0.0f, scale = 1.0f;
        for (const Rgb& e : E) largest = std::max(largest, strength(e));
        while (largest / scale > 32768.0f) scale *= 2.0f;
        for (Rgb& e : E) e /= scale;
        OutputSet set(b.options.out / "passes");
        writeExr(set.open(fmt::format("pass.{:03}.exr", pass)), b.map.width, b.map.height,
                 {{"R", &E[0].r, 3}, {"G", &E[0].g, 3}, {"B", &E[0].b, 3}}, {{"lmcScale", scale * float(b.lightUnit)}});
        set.commit();
      };
    Run part = b.run.part(0.5 * half, 0.5 * (half + 1));
    if (b.options.snapshot) part.journal = nullptr;  // its pictures are wanted
    Solution& s = b.solutions[half];
    Journaled kept(
        part, *b.tracer, {Loop::Solve, half, 0}, [&](auto& archive) { keep(s, b.patches.patches.size(), archive); }, WorkOf::All);
    if (kept.taken()) continue;
    s = shoot(b.scene, *b.tracer, b.patches, b.patchLight, options, part);
    kept.put();
  }
  b.summary = fmt::format("shooting, {} passes, tail at most {:.2g}", b.solutions[0].passes, b.tail());
}

}  // namespace

namespace {

/// Path of the object that has the first value which is not finite, else the one that most bounced light falls on.
std::string suspectOf(const Bake& b, const Bounced& illuminance) {
  std::vector<double> light(b.scene.objects.size(), 0.0);
  for (std::size_t i = 0; i < illuminance.size(); ++i) {
    const Patch& p = b.patches.patches[i];
    const double flux = p.area_m2 * double(illuminance[i].r + illuminance[i].g + illuminance[i].b);
    if (!std::isfinite(flux)) return b.scene.objects[p.object].path;
    light[p.object] += flux;
  }
  return light.empty() ? std::string() : b.scene.objects[std::size_t(std::ranges::max_element(light) - light.begin())].path;
}

}  // namespace

void solve(Bake& b) {
  if (b.patches.patches.empty()) return;
  const std::size_t n = b.patches.patches.size();
  if (b.options.solver == Solver::Dense && n > kMaxDensePatches)
    throw Error(Exit::Limit, b.scene.file, "",
                fmt::format("--solver dense takes at most {} patches, the level has {}: raise --patch-size", kMaxDensePatches, n),
                "LMC_DENSE");
  b.solver = solverFor(b);
  switch (b.solver) {
    case Solver::Dense:
      solveDensely(b);
      break;
    case Solver::Hierarchical:
      solveByLinks(b);
      break;
    case Solver::Shooting:
      solveByShooting(b);
      break;
    case Solver::Auto:
    case Solver::Stored:
      solveByStoredRays(b);
      break;
  }
  for (const Solution& s : b.solutions) {
    const double off = s.energy.imbalance();
    if (off > kFailImbalance)
      throw Error(Exit::Numerical, b.scene.file, "",
                  fmt::format("energy does not balance: {:.3g} of the bounced light is made or lost; most of it is about object '{}'", off,
                              suspectOf(b, s.illuminance)),
                  "LMC_ENERGY");
    if (off > kWarnImbalance)
      b.run.warn({{},
                  b.scene.file.string(),
                  "",
                  fmt::format("energy is off balance by {:.2g}; most of it is about object '{}'", off, suspectOf(b, s.illuminance)),
                  "LMC_ENERGY"});
  }
  const DirectMap seen{b.map.width, b.map.height, b.values.direct.data(), b.map.chart.data(), &b.charts, b.map.edge.data()};
  b.field = std::make_unique<Field>(b.scene, b.patches, seen, *b.texels, b.patchLight,
                                    std::array<const Bounced*, 2>{&b.solutions[0].illuminance, &b.solutions[1].illuminance},
                                    b.coarseSolution.empty() ? nullptr : &b.coarseSolution, b.run, b.memory.paged());
}

void hemisphere(Bake& b) {
  if (!b.field && !b.plan.runs(Effect::Sky)) {
    b.summary = "no sky and no bounces";
    return;
  }
  const Gather gather(b.scene, *b.tracer, *b.direct, b.field.get(), b.plan.runs(Effect::Near), b.run.seed);
  bakeHemisphere(b.map, b.scene, *b.texels, *b.tracer, gather,
                 {.goal = b.options.goal,
                  .interpolate = b.options.interpolate,
                  .tail = b.tail(),
                  .rays = b.options.gatherRays,
                  .rounds = b.options.gatherRounds,
                  .goOn = b.goOn,
                  .leftOut = b.plan.leftOut},
                 b.run);
  double rays = 0.0, texels = 0.0;
  for (std::size_t i = 0; i < b.map.size(); ++i) {
    rays += 2.0 * b.map.rays[i];
    texels += b.map.chart[i] != kNone;
  }
  b.summary = fmt::format("{:.0f} rays a texel", texels > 0.0 ? rays / texels : 0.0);
}

void finish(Bake& b) {
  if (b.options.explain) b.explained = explainTexel(b);
  b.field.reset();
  b.values = values(b.map, b.scene);
  if (b.options.explain) addValues(b.explained, b);
  b.ledger = ledger(b.map, b.scene, {b.tail(), b.tailEstimate(), b.plan.leftOut, b.plan.leftOutObject});
  b.stated = statedErrors(b.map, b.scene);
  // Halves and sums are done with: what is written needs the room.
  for (std::size_t h = 0; h < 2; ++h) {
    b.map.direct[h] = b.map.bounced[h] = {};
    b.map.sky[h] = {};
  }
  b.map.coarse = b.map.variance = {};
  std::vector<float> largest(std::size_t(b.uv.maps), 0.0f);
  for (std::size_t i = 0; i < b.map.size(); ++i) {
    const Rgb e = b.values.direct[i] + b.values.indirect[i];
    if (!std::isfinite(e.r + e.g + e.b) || !std::isfinite(b.values.error[i].r + b.values.error[i].g + b.values.error[i].b))
      throw Error(Exit::Numerical, b.scene.file, "",
                  fmt::format("texel ({}, {}) of the map is not finite (object '{}')", i % std::size_t(b.map.width),
                              i / std::size_t(b.map.width), b.scene.objects[b.map.object[i]].path),
                  "LMC_NOT_FINITE");
    float& most = largest[i / (b.map.size() / largest.size())];
    most = std::max({most, strength(e), strength(b.values.error[i])});
  }
  for (const float most : largest) {
    b.scales.push_back(1.0f);
    while (most / b.scales.back() > 32768.0f) b.scales.back() *= 2.0f;
    b.scales.back() = float(double(b.scales.back()) * b.lightUnit);
    if (!std::isfinite(b.scales.back()))
      throw Error(Exit::Numerical, b.scene.file, "", "the level is too bright for 32-bit floats", "LMC_NOT_FINITE");
  }
  b.summary = fmt::format("error {:.2f} % (noise {:.2f}, patches {:.2f}, tail {:.2f}), at most {:.2f} %", 100.0 * b.ledger.estimate,
                          100.0 * b.ledger.noise, 100.0 * b.ledger.field, 100.0 * b.ledger.tail, 100.0 * b.ledger.bound95);
}

PathOptions pathsFor(const Bake& b) {
  PathOptions out;
  out.shadows = b.plan.isMeant(Effect::Shadow);
  out.bounces = !b.plan.isMeant(Effect::Bounce) ? 0 : b.options.passes > 0 ? b.options.passes : -1;
  return out;
}

bool isChecked(const BakeOptions& o) { return o.audit == Audit::On || (o.audit == Audit::Auto && o.goal < kAuditGoal); }

void checkByPaths(Bake& b) {
  if (!b.tracer || !isChecked(b.options)) {
    b.summary = "left out";
    return;
  }
  AuditOptions options;
  options.rays = std::uint64_t(kAuditShare * double(b.tracer->rays()));
  options.paths = pathsFor(b);
  b.audit = audit(b.map, b.values, b.scene, *b.texels, *b.tracer, b.stated, options, b.ledger, b.run);
  if (b.audit.drawn == 0) {
    b.summary = "nothing to check, or too few rays for it";
    return;
  }
  const Found& f = b.audit.found;
  b.summary = fmt::format("{} texels, {} paths: error {:.2f} % ({:.2f} to {:.2f}), bias {:+.2f} +- {:.2f} %", b.audit.drawn, b.audit.paths,
                          100.0 * f.rms(), 100.0 * f.low(1.96), 100.0 * f.high(1.96), 100.0 * f.bias, 100.0 * f.biasError);
  if (!b.audit.contradicts) return;
  b.run.warn(
      {{},
       b.scene.file.string(),
       "",
       fmt::format("path tracing of {} texels contradicts the stated error: it is {:.2f} % at least, and the bound is raised to {:.2f} %",
                   b.audit.drawn, 100.0 * f.low(1.96), 100.0 * b.ledger.bound95),
       "LMC_AUDIT"});
}

namespace {

/// Of each vertex in the stack of maps, [0, 1].
std::vector<glm::vec2> placesInStack(const Bake& b) {
  std::vector<glm::vec2> out(b.scene.mapUv.size());
  for (const Object& o : b.scene.objects)
    for (std::uint32_t v = o.firstVertex; v < o.firstVertex + o.vertexCount; ++v)
      out[v] = glm::vec2(b.scene.mapPlace(o, v, b.uv.side) / glm::dvec2(b.map.width, b.map.height));
  return out;
}

}  // namespace

void occlude(Bake& b) {
  if (!b.plan.runs(Effect::Ao) && !b.plan.runs(Effect::Bent)) {
    b.summary = "left out";
    return;
  }
  ao::Options options = b.options.ao.how;
  options.bent = b.plan.runs(Effect::Bent);
  b.openness = ao::bakeMap(b.scene, *b.texels, b.map.chart, *b.tracer, options, b.run);
  noteDarkness(b.openness, options, b.scene.file, b.run);
  if (options.bent && b.options.ao.bentInTangentSpace)
    bentToTangentSpace(b.openness, b.scene, placesInStack(b), b.map.width, b.map.height, b.run);
  b.summary = fmt::format("{:.0f} rays a texel, error {:.4f}", double(b.openness.rays) / std::max(1.0, double(b.openness.asked)),
                          b.openness.rmsError);
}

void rims(Bake& b) {
  if (!b.plan.runs(Effect::Rims)) {
    b.summary = "left out";
    return;
  }
  b.rimsFilled = fillRims(b.values, b.map, freePlaces(b.values, b.map, b.scene, *b.texels, *b.tracer, b.run));
  b.ledger.rims = b.ledger.mean > 0.0 ? b.rimsFilled.rmsMove_lx / b.ledger.mean : 0.0;
  b.summary = fmt::format("{} texels partly in solids, moved by {:.2f} % of the light, RMS", b.rimsFilled.texels, 100.0 * b.ledger.rims);
}

void seams(Bake& b) {
  b.padding = makePadding(b.scene, b.charts, b.map.chart, b.uv.side, b.run);
  if (const auto& tight = b.padding.contested; !tight.empty())
    b.run.note(
        {{},
         b.scene.file.string(),
         "",
         fmt::format("{} texels are read from two light-map charts at once, the first at ({}, {}): charts lie too near for maps of {} x {}",
                     tight.size(), tight[0] % std::uint32_t(b.uv.side), tight[0] / std::uint32_t(b.uv.side), b.uv.side, b.uv.side),
         "LMC_UV_TIGHT"});
  if (b.openness.asked > 0) padOpenness(b.openness, b.padding);
  if (!b.plan.runs(Effect::Seams)) {
    fillPadding(b.values, b.padding);
    b.summary = "seams left as they are";
    return;
  }
  b.closed = closeSeams(b.values, b.map, b.scene, b.charts, b.padding, b.seams, b.options.goal, b.run);
  b.ledger.seams = b.closed.rmsMove;
  b.summary = fmt::format("{} chart edges, jumps from {:.2f} % to {:.2f} % RMS, {} texels moved", b.seams.smooth.size(),
                          100.0 * b.closed.before.relativeRms, 100.0 * b.closed.after.relativeRms, b.closed.moved);
}

}  // namespace lmc
