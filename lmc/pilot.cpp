#include "lmc/pilot.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "lmc/memory.h"
#include "lmc/stages.h"

namespace lmc {

namespace {

constexpr double kSquares = 400.0;         // patches of the pilot
constexpr std::uint32_t kStoredRays = 32;  // of a patch, each half
constexpr double kPilotTail = 0.01;
constexpr std::uint32_t kStream = 4;  // of random numbers: apart from those of the bake
// Of the map's cells that get hemisphere rays: this share, but texels enough to tell, and no more than that takes.
constexpr double kSampled = 0.08, kLeastTexels = 7500.0, kMostTexels = 30000.0;
// A finer goal is foretold from this one: its own rounds would take as much of the bake again as they do at this.
constexpr double kSampledGoal = 0.02;
// Rays go with goal^-1.9 (measured, 1.6 to 2.3): noise alone with -1.43, and points are more. Their time goes with -1.55 (1.0 to 2.0), for
// what a point takes beside is shared by more.
constexpr double kFinerRays = 1.9, kFinerTime = 1.55;
constexpr double kPathRay = 0.6;        // what a ray of the audit takes, against one of the gather
constexpr double kFinerSpread = 0.2;    // of that for half the goal, in the logarithm
constexpr std::size_t kAoBlocks = 250;  // of kAoBlock x kAoBlock texels, for rays of ambient occlusion
constexpr std::uint32_t kFewAoRays = 32;
constexpr double kManyAoRays = 96.0, kMostAoRays = 256.0, kAoShare = 0.02;  // a texel of these, to learn what a ray takes: 2 % of the work
constexpr int kAoBlock = 4;
// Bounds above what is measured: on every texel of the map by two places; and what coarse patches see of the sky and of bounces.
constexpr double kDirectMargin = 1.1, kPatchMargin = 1.5;

// What a stage takes beside its rays [s], from bakes of the reference scenes. Rays are timed by the pilot itself.
constexpr double kGatherTexel_s = 0.4e-6;             // of the gather
constexpr double kManyRays = 0.92;                    // a ray among many neighbours, against one of a sample
constexpr double kAoTexel_s = 1.5e-6, kAoHard = 1.1;  // rays of later rounds go where geometry is dense
constexpr double kSeam_s = 2.5e-4, kFinishTexel_s = 0.15e-6;
constexpr double kRimRays = 9.6, kRimTexel_s = 2.2e-6;  // a texel
constexpr double kLeastRay_s = 0.02e-6;
// Against the pilot's patches: how many the bake makes at a goal of 2 %, and how often it does to them what the pilot does once.
constexpr double kFinerPatches = 3.5, kMeshAgain = 3.0, kLightAgain = 3.0;
// Spread of what comes out of these, beside what sampling leaves: standard deviations of the logarithm.
constexpr double kFewBlocks = 1.4;
constexpr double kDirectShare = 0.7;  // of the pilot's own time: it looks at every texel for direct light, at a few for the rest
constexpr double kDirectSpread = 0.2, kPatchSpread = 0.3, kGatherSpread = 0.25, kAoSpread = 0.2, kSeamSpread = 0.5, kRimSpread = 0.5;

class Clock {
 public:
  double lap() {
    const double now = cpuSeconds(), out = now - last_;
    last_ = now;
    return out;
  }

 private:
  double last_ = cpuSeconds();
};

/// Blocks of texels spread evenly over those that hold any; all others are as if not covered.
struct Sample {
  TexelArray<std::uint32_t> chart;
  double texels = 0.0, all = 0.0;
};
Sample sampleOf(const LightMap& map, int side, std::size_t most) {
  const std::size_t across = std::size_t(map.width + side - 1) / std::size_t(side);
  const auto blockOf = [&](std::size_t i) {
    return i / std::size_t(map.width) / std::size_t(side) * across + i % std::size_t(map.width) / std::size_t(side);
  };
  std::vector<std::uint32_t> covered(blockOf(map.size() - 1) + 1, 0);
  for (std::size_t i = 0; i < map.size(); ++i) covered[blockOf(i)] += map.chart[i] != kNone;
  const auto blocks = std::size_t(std::ranges::count_if(covered, [](std::uint32_t n) { return n > 0; }));
  Sample out;
  std::vector<bool> taken(covered.size(), false);
  std::size_t rank = 0;
  for (std::size_t k = 0; k < covered.size(); ++k) {
    if (covered[k] == 0) continue;
    taken[k] = blocks <= most || (rank + 1) * most / blocks > rank * most / blocks;
    ++rank;
    out.all += covered[k];
    if (taken[k]) out.texels += covered[k];
  }
  out.chart.assign(map.size(), kNone);
  for (std::size_t i = 0; i < map.size(); ++i)
    if (taken[blockOf(i)]) out.chart[i] = map.chart[i];
  return out;
}

/// What an effect gives to each object: mean over its texels of the light [lx] and of its square.
struct ByObject {
  explicit ByObject(std::size_t objects) : mean(objects, 0.0), mean2(objects, 0.0) {}
  std::vector<double> mean, mean2;
};

/// The state of one pilot.
class PilotRun {
 public:
  explicit PilotRun(Bake& b) : b_(b), silent_(b.run.silent()), texels_(b.scene.objects.size(), 0.0) {
    for (std::size_t i = 0; i < b.map.size(); ++i)
      if (b.map.chart[i] != kNone) texels_[b.map.object[i]] += 1.0;
    all_ = std::accumulate(texels_.begin(), texels_.end(), 0.0);
  }

  Pilot run() {
    const std::uint64_t raysBefore = b_.tracer->rays();
    const double cpuBefore = cpuSeconds();
    const bool lit = b_.plan.runs(Effect::Direct) || b_.plan.runs(Effect::Area) || b_.plan.runs(Effect::Sky);
    if (lit && all_ > 0.0) light();
    if (isChecked(b_.options)) {
      const double spent = double(b_.tracer->rays() - raysBefore);
      const double rays = kAuditShare * (spent + out_.direct.rays + out_.patches.rays + out_.solve.rays + out_.gather.rays);
      out_.audit = forecast(rays, kPathRay * gatherRay_s_ * rays, kGatherSpread);
    }
    if (b_.plan.runs(Effect::Ao) || b_.plan.runs(Effect::Bent)) openness();
    if (b_.plan.runs(Effect::Seams)) out_.seams = forecast(0.0, kSeam_s * double(b_.seams.smooth.size()), kSeamSpread);
    if (b_.plan.runs(Effect::Rims)) out_.rims = forecast(kRimRays * all_, kRimTexel_s * all_, kRimSpread);
    out_.rest = forecast(0.0, kFinishTexel_s * double(b_.map.size()), kSeamSpread);
    out_.rays = double(b_.tracer->rays() - raysBefore);
    out_.cpu_s = cpuSeconds() - cpuBefore;
    return std::move(out_);
  }

 private:
  static Forecast forecast(double rays, double cpu_s, double spread) {
    return {rays, cpu_s, cpu_s * std::exp(-1.645 * spread), cpu_s * std::exp(1.645 * spread)};
  }

  void light() {
    const DirectLight direct(b_.scene, *b_.tracer, b_.plan.runs(Effect::Shadow));
    const MapOptions options{b_.options.goal};
    Clock clock;
    const DirectPilot seen = pilotDirect(b_.map, b_.scene, *b_.texels, direct, options, b_.run.part(0.0, kDirectShare));
    if (seen.rays > 0.0) out_.direct = forecast(seen.rays, std::max(kLeastRay_s, seen.ray_s) * seen.rays, kDirectSpread);
    const bool bounce = b_.plan.runs(Effect::Bounce), sky = b_.plan.runs(Effect::Sky);
    TexelArray<Rgb> mean(bounce || sky ? b_.map.size() : 0);
    for (std::size_t i = 0; i < mean.size(); ++i) mean[i] = 0.5f * (b_.map.direct[0][i] + b_.map.direct[1][i]);
    const DirectMap known{b_.map.width, b_.map.height, mean.data(), b_.map.chart.data(), &b_.charts, b_.map.edge.data()};

    const std::size_t objects = texels_.size();
    ByObject bounced(objects), open(objects), near(objects);
    std::vector<double> light(objects, 0.0);  // mean over channels
    for (std::size_t o = 0; o < objects; ++o)
      if (texels_[o] > 0.0) light[o] = seen.objects[o].light / texels_[o];
    if (bounce || sky) {
      clock.lap();
      PatchMesh mesh = makePatches(b_.scene, {.size_m = patchSizeFor_m(b_.scene, kSquares), .maxPatches = b_.options.maxPatches}, silent_);
      for (Patch& p : mesh.patches) p.reflectance = glm::min(p.reflectance, Rgb(kMostReflectance));
      const double mesh_s = clock.lap();
      const auto before = double(b_.tracer->rays());
      exposePatches(mesh, b_.scene, *b_.tracer, silent_);
      const PatchLight patchLight = lightPatches(b_.scene, *b_.tracer, mesh, direct, known, silent_);
      const double light_s = clock.lap(), lightRays = double(b_.tracer->rays()) - before;
      std::array<Solution, 2> solutions;
      if (bounce) {
        StoredOptions stored;
        stored.rays = kStoredRays;
        stored.maxTail = kPilotTail;
        for (std::uint32_t half = 0; half < 2; ++half) {
          stored.stream = kStream + half;
          solutions[half] = solveStored(b_.scene, *b_.tracer, mesh, patchLight, stored, silent_).solution;
        }
        out_.bounces = solutions[0].passes;
      }
      const double solve_s = clock.lap();
      measurePatches(mesh, patchLight, solutions, bounced, open, light);
      std::unique_ptr<Field> field;
      if (bounce)
        field = std::make_unique<Field>(b_.scene, mesh, known, *b_.texels, patchLight,
                                        std::array<const Bounced*, 2>{&solutions[0].illuminance, &solutions[1].illuminance}, nullptr,
                                        silent_, true);
      const double field_s = clock.lap();
      near = hemisphere(direct, field.get(), mean, options);
      if (bounce) {
        const double finer = std::min(kFinerPatches * squaresFor(b_.options.goal) / squaresFor(0.02),
                                      double(b_.options.maxPatches) / double(mesh.patches.size()));
        out_.patches = forecast(finer * lightRays, kMeshAgain * mesh_s + kLightAgain * finer * light_s, kPatchSpread);
        out_.solve = forecast(2.0 * kStoredRays * finer * double(mesh.patches.size()), finer * solve_s + field_s, kPatchSpread);
      }
    }
    contributions(seen, bounced, open, near, light);
  }

  /// Light of the sky and of bounces on patches, by object: squares of the largest channel, and what they add to the light.
  void measurePatches(const PatchMesh& mesh, const PatchLight& patchLight, const std::array<Solution, 2>& solutions, ByObject& bounced,
                      ByObject& open, std::vector<double>& light) {
    const std::size_t objects = texels_.size();
    std::vector<double> area(objects, 0.0), added(objects, 0.0);
    ByObject level(2);  // of bounces, of the sky
    double albedo = 0.0, all = 0.0, left = 0.0, seen = 0.0;
    const auto add = [](ByObject& to, std::size_t i, double area_m2, const Rgb& e) {
      to.mean[i] += area_m2 * double(strength(e));
      to.mean2[i] += area_m2 * double(strength(e)) * double(strength(e));
    };
    for (std::size_t i = 0; i < mesh.patches.size(); ++i) {
      const Patch& p = mesh.patches[i];
      const Rgb b = solutions[0].illuminance.empty() ? Rgb(0.0f) : 0.5f * (solutions[0].illuminance[i] + solutions[1].illuminance[i]);
      const Rgb s = patchLight.sky[i];
      area[p.object] += p.area_m2;
      added[p.object] += p.area_m2 * mean3(b + s);
      add(bounced, p.object, p.area_m2, b);
      add(open, p.object, p.area_m2, s);
      add(level, 0, p.area_m2, b);
      add(level, 1, p.area_m2, s);
      albedo += p.area_m2 * mean3(p.reflectance);
      all += p.area_m2;
      left += p.left;
      seen += double(p.left) + double(p.fronts) + double(p.backs);
    }
    out_.meanAlbedo = all > 0.0 ? albedo / all : 0.0;
    out_.openShare = seen > 0.0 ? left / seen : 0.0;
    for (std::size_t o = 0; o < objects; ++o) {
      if (area[o] > 0.0) {
        light[o] += added[o] / area[o];
        for (ByObject* by : {&bounced, &open}) {
          by->mean[o] /= area[o];
          by->mean2[o] /= area[o];
        }
      } else if (all > 0.0) {
        // What has no patches of its own (it casts nothing) gets what there is elsewhere.
        bounced.mean[o] = level.mean[0] / all;
        bounced.mean2[o] = level.mean2[0] / all;
        open.mean[o] = level.mean[1] / all;
        open.mean2[o] = level.mean2[1] / all;
      }
    }
  }

  /// Returns the light of near hits.
  ByObject hemisphere(const DirectLight& direct, const Field* field, const TexelArray<Rgb>& mean, MapOptions options) {
    const TexelArray<std::uint32_t> whole = b_.map.chart;
    // The noise of two places is none of the bake's.
    b_.map.direct[0] = b_.map.direct[1] = mean;
    options.interpolate = b_.options.interpolate;
    options.rays = b_.options.gatherRays;
    options.sampled = std::min(0.999, std::clamp(kSampled * all_, kLeastTexels, kMostTexels) / all_);
    options.goal = std::max(options.goal, kSampledGoal);
    const double finer = options.rays > 0 ? 1.0 : options.goal / b_.options.goal;
    // What is near a patch of the bake's.
    const auto nearSizes = float(std::sqrt(kSquares / squaresFor(options.goal)));
    const Gather gather(b_.scene, *b_.tracer, direct, field, b_.plan.runs(Effect::Near), b_.run.seed, nearSizes);
    Clock clock;
    double cells_s = 0.0;
    const double cellsBefore = rays(Purpose::Cells), nearBefore = nearRays();
    const HemisphereForecast told = foretellHemisphere(
        b_.map, b_.scene, *b_.texels, *b_.tracer, gather, options, [&] { cells_s = clock.lap(); }, silent_);
    std::ranges::copy(whole, b_.map.chart.begin());  // in place: the field reads it there
    const auto size = double(b_.map.size());
    const double nearCast = nearRays() - nearBefore;
    gatherRay_s_ = kManyRays * std::max(kLeastRay_s, told.cast_s / std::max(1.0, told.cast + nearCast));
    // Few blocks know little of their own spread.
    const double spread =
        std::hypot(kGatherSpread, told.rays > 0.0 ? kFewBlocks * told.standardError / told.rays : 0.0, kFinerSpread * std::log2(finer));
    const double all = told.rays + told.near * nearCast / std::max(1.0, told.nearCast);
    out_.gather = forecast(rays(Purpose::Cells) - cellsBefore + std::pow(finer, kFinerRays) * all,
                           cells_s + kGatherTexel_s * size + std::pow(finer, kFinerTime) * gatherRay_s_ * all, spread);
    const std::size_t objects = texels_.size();
    ByObject near(objects);
    for (std::size_t o = 0; o < objects; ++o) {
      // What is not in the sample gets what there is elsewhere.
      const auto& own = told.nearLight[told.nearLight[o].texels > 0.0 ? o : objects];
      near.mean[o] = own.mean;
      near.mean2[o] = own.mean2;
    }
    return near;
  }

  void openness() {
    const Sample sample = sampleOf(b_.map, kAoBlock, kAoBlocks);
    if (!(sample.texels > 0.0)) return;
    const double all = sample.all / sample.texels;
    // The same texels with few rays and with many: what a texel takes, and what a ray.
    ao::Options options = b_.options.ao.how;
    const auto cast = [&] { return ao::foretellMap(b_.scene, *b_.texels, sample.chart, *b_.tracer, options, silent_); };
    const double told = all * cast().rays;
    options.rays = kFewAoRays;
    cast();  // what the first times take beside, pages of memory that are new, is no part of a ray
    const ao::MapForecast few = cast();
    options.rays = std::uint32_t(std::clamp(kAoShare * told / sample.texels, kManyAoRays, kMostAoRays));
    const ao::MapForecast many = cast();
    const double ray_s = std::max(kLeastRay_s, (many.cast_s - few.cast_s) / std::max(1.0, many.cast - few.cast));
    out_.occlude = forecast(told, kAoTexel_s * sample.all + kAoHard * ray_s * told, kAoSpread);
  }

  /// Bounds of what each effect gives, its own bounces included.
  void contributions(const DirectPilot& seen, const ByObject& bounced, const ByObject& open, const ByObject& near,
                     const std::vector<double>& light) {
    const std::size_t objects = texels_.size();
    for (std::size_t o = 0; o < objects; ++o) out_.mean_lx += texels_[o] * light[o] / all_;
    if (!(out_.mean_lx > 0.0)) return;
    const auto of = [&](ObjectLight::Sums ObjectLight::*sums) {
      ByObject out(objects);
      for (std::size_t o = 0; o < objects; ++o)
        if (texels_[o] > 0.0) {
          out.mean[o] = (seen.objects[o].*sums).sum / texels_[o];
          out.mean2[o] = (seen.objects[o].*sums).sum2 / texels_[o];
        }
      return out;
    };
    // Light sent on by bounces adds to what it is in the mean over the level, and goes anywhere in it.
    const double sentOn = b_.plan.runs(Effect::Bounce) ? 1.0 / (1.0 - std::min(0.99, out_.meanAlbedo)) - 1.0 : 0.0;
    const auto give = [&](Effect effect, const ByObject& by, double margin, double again) {
      if (!b_.plan.runs(effect)) return;
      Contribution& c = out_.effects[std::size_t(effect)];
      c.known = true;
      double level2 = 0.0;
      for (std::size_t o = 0; o < objects; ++o) {
        level2 += texels_[o] * by.mean2[o] / all_;
        c.share += texels_[o] * by.mean[o] / all_ / out_.mean_lx;
      }
      const double level = std::sqrt(level2);
      c.bound = margin * (1.0 + again) * level / out_.mean_lx;
      for (std::size_t o = 0; o < objects; ++o) {
        if (texels_[o] == 0.0) continue;
        const double own = std::sqrt(by.mean2[o]);
        const double bound = margin * (own + again * std::max(own, level)) / std::max(light[o], kDimRoom * out_.mean_lx);
        if (bound <= c.object) continue;
        c.object = bound;
        c.objectPath = b_.scene.objects[o].path;
      }
    };
    const ByObject punctual = of(&ObjectLight::punctual), area = of(&ObjectLight::area);
    ByObject hidden = of(&ObjectLight::hidden);
    // No shadow was met in so many texels: at 95 % it lies on no more than three of them.
    for (std::size_t o = 0; o < objects; ++o) hidden.mean2[o] += 3.0 / std::max(3.0, texels_[o]) * (punctual.mean2[o] + area.mean2[o]);
    give(Effect::Direct, punctual, kDirectMargin, sentOn);
    give(Effect::Area, area, kDirectMargin, sentOn);
    give(Effect::Shadow, hidden, kDirectMargin, sentOn);
    give(Effect::Sky, open, kPatchMargin, sentOn);
    give(Effect::Bounce, bounced, kPatchMargin, 0.0);
    // Either way of reading it gives some light: they differ by no more than the larger of the two.
    give(Effect::Near, near, kPatchMargin, 0.0);
    for (std::size_t i = 0; i < b_.scene.lights.size(); ++i) {
      const DirectPilot::Given& g = seen.lights[i];
      out_.lamps.push_back({b_.scene.lights[i].path, g.texels / all_, kDirectMargin * std::sqrt(g.sum2 / all_) / out_.mean_lx});
    }
  }

  /// Rays of near hits: on from there, and to the lamps.
  double nearRays() const { return rays(Purpose::Near) + rays(Purpose::Shadow) + rays(Purpose::Emitter); }
  double rays(Purpose p) const { return double(b_.tracer->rays(p)); }
  static double mean3(const Rgb& c) { return (double(c.r) + double(c.g) + double(c.b)) / 3.0; }

  Bake& b_;
  Run silent_;
  std::vector<double> texels_;  // of each object
  double all_ = 0.0;
  double gatherRay_s_ = 0.0;
  Pilot out_;
};

}  // namespace

Pilot runPilot(Bake& b) {
  Pilot out = PilotRun(b).run();
  // As they were before: what a pilot leaves in the map is no part of it.
  for (std::size_t h = 0; h < 2; ++h) {
    b.map.direct[h].assign(b.map.size(), Rgb(0.0f));
    b.map.bounced[h] = {};
    b.map.sky[h] = {};
  }
  b.map.coarse = b.map.variance = {};
  b.map.interpolation2 = {};
  b.map.edge.assign(b.map.size(), 0);
  b.map.rays.assign(b.map.size(), 0);
  return out;
}

}  // namespace lmc
