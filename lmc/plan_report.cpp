#include "lmc/plan_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <span>

namespace lmc {

using Json = nlohmann::ordered_json;

namespace {

constexpr const char* kFirstForetold = "direct";  // the stage after the pilot
constexpr double kUnrest_s = 0.03;                // by which two bakes of the same level differ, however short

/// The stages in which an effect is simulated.
std::vector<std::string_view> stagesOf(Effect effect) {
  switch (effect) {
    case Effect::Direct:
    case Effect::Area:
    case Effect::Shadow:
      return {"direct"};
    case Effect::Bounce:
      return {"patches", "solve", "gather"};
    case Effect::Sky:
      return {"gather"};
    case Effect::Ao:
    case Effect::Bent:
      return {"occlude"};
    case Effect::Seams:
      return {"seams"};
    case Effect::Rims:
      return {"rims"};
    case Effect::Tangents:
    case Effect::Near:
    case Effect::Colour:
    case Effect::Alpha:
    case Effect::Specular:
    case Effect::ScreenAo:
      break;
  }
  return {};
}

struct Spent {
  double cpu_s = 0.0, rays = 0.0;
};
Spent spentOn(std::span<const std::string_view> names, const std::vector<StageTime>& stages) {
  Spent out;
  for (const StageTime& t : stages)
    if (std::ranges::find(names, t.name) != names.end()) {
      out.cpu_s += t.cpuSeconds;
      out.rays += double(t.rays);
    }
  return out;
}

/// Stages from the load to the pilot, and those that were foretold.
std::pair<Spent, Spent> aroundForecast(const std::vector<StageTime>& stages) {
  std::pair<Spent, Spent> out;
  bool foretold = false;
  for (const StageTime& t : stages) {
    foretold = foretold || t.name == kFirstForetold;
    Spent& s = foretold ? out.second : out.first;
    s.cpu_s += t.cpuSeconds;
    s.rays += double(t.rays);
  }
  return out;
}

const char* nameOf(Effect e) { return kEffectNames[std::size_t(e)]; }

const char* shapeName(Shape s) {
  switch (s) {
    case Shape::Flat:
      return "flat";
    case Shape::SeenFromInside:
      return "convex, seen from inside";
    case Shape::SeenFromOutside:
      return "convex, seen from outside";
    case Shape::Any:
      break;
  }
  return "any";
}

std::string percent(double share) { return fmt::format("{:.3g} %", 100.0 * share); }
std::string rayText(double rays) {
  return rays >= 1e6   ? fmt::format("{:.1f} M", rays / 1e6)
         : rays >= 1e3 ? fmt::format("{:.0f} k", rays / 1e3)
                       : fmt::format("{:.0f}", rays);
}

}  // namespace

Json planOf(const Bake& b, const std::vector<StageTime>& stages) {
  Json out = Json::array();
  for (const Step& s : b.plan.steps) {
    Json step = {{"effect", nameOf(s.effect)}, {"run", s.run}, {"because", s.because}};
    if (s.light.known) {
      step["share"] = s.light.share;
      step["bound"] = s.light.bound;
      step["bound_object"] = s.light.object;
      step["bound_object_path"] = s.light.objectPath;
      step["left_out"] = s.tooWeak;
    }
    if (b.facts.pilot) {
      const Cost c = costOf(s.effect, b.plan, *b.facts.pilot);
      if (c.with) step["with"] = nameOf(*c.with);
      if (c.forecast) {
        step["forecast"] = {{"cpu_seconds", c.forecast->cpu_s},
                            {"least_cpu_seconds", c.forecast->least_s},
                            {"most_cpu_seconds", c.forecast->most_s},
                            {"rays", c.forecast->rays}};
        if (std::ranges::find(stages, kFirstForetold, &StageTime::name) != stages.end()) {
          const Spent spent = spentOn(stagesOf(s.effect), stages);
          step["actual"] = {{"cpu_seconds", spent.cpu_s}, {"rays", spent.rays}};
        }
      }
    }
    out.push_back(std::move(step));
  }
  return out;
}

Json forecastOf(const Bake& b, const std::vector<StageTime>& stages) {
  const auto [before, after] = aroundForecast(stages);
  const Forecast f = b.facts.pilot ? forecastOf(b.plan, *b.facts.pilot) : Forecast{};
  Json out = {{"cpu_seconds", before.cpu_s + f.cpu_s},
              {"least_cpu_seconds", std::max(0.0, before.cpu_s + f.least_s - kUnrest_s)},
              {"most_cpu_seconds", before.cpu_s + f.most_s + kUnrest_s},
              {"rays", before.rays + f.rays},
              {"memory_bytes", b.memory.peak_bytes()},
              {"disk_bytes", b.memory.disk_bytes()}};
  if (b.facts.pilot) out["pilot"] = {{"cpu_seconds", b.facts.pilot->cpu_s}, {"rays", b.facts.pilot->rays}};
  if (std::ranges::find(stages, kFirstForetold, &StageTime::name) != stages.end())
    out["actual"] = {{"cpu_seconds", before.cpu_s + after.cpu_s}, {"rays", before.rays + after.rays}};
  return out;
}

Json factsOf(const Bake& b) {
  const Facts& f = b.facts;
  Json out = {
      {"lights",
       {{"point", f.pointLights},
        {"spot", f.spotLights},
        {"directional", f.directionalLights},
        {"dark", f.darkLights},
        {"with_range", f.rangedLights},
        {"dynamic", f.dynamicLights}}},
      {"emissive", {{"triangles", f.emissiveTriangles}, {"area_m2", f.emissiveArea_m2}, {"power_lm", f.emissivePower_lm * b.lightUnit}}},
      {"sky", f.sky},
      {"grey", f.grey},
      {"receivers", f.receivers},
      {"blockers", f.blockers},
      {"masked_triangles", f.maskedTriangles},
      {"masked_materials", f.maskedMaterials},
      {"materials_with_holes", f.holedMaterials},
      {"mirrored_objects", f.mirroredObjects},
      {"dynamic_meshes", f.dynamicMeshes},
      {"tangent_materials", f.tangentMaterials},
      {"shining_materials", f.shinyMaterials},
      {"ambient", f.ambient},
      {"largest_reflectance", f.largestReflectance},
      {"shape", shapeName(f.shape)},
      {"lamps_in_front", f.lampsInFront}};
  if (f.smoothSeams) out["smooth_seams"] = *f.smoothSeams;
  if (!f.pilot) return out;
  const Pilot& p = *f.pilot;
  out["mean_illuminance_lx"] = p.mean_lx * b.lightUnit;
  out["open_share"] = p.openShare;
  out["mean_albedo"] = p.meanAlbedo;
  out["passes"] = p.bounces;
  Json lamps = Json::array();
  for (const LampFact& l : p.lamps) lamps.push_back({{"light", l.path}, {"texels", l.texels}, {"bound", l.bound}});
  out["lamps"] = std::move(lamps);
  return out;
}

std::string planText(const Bake& b, const std::vector<StageTime>& stages) {
  std::string out = fmt::format("{:<9} {:<5} {:>8} {:>8} {:>8} {:>16} {:>8}  {}\n", "effect", "runs", "share", "bound", "object", "CPU s",
                                "rays", "because");
  for (const Step& s : b.plan.steps) {
    std::string share = "-", bound = "-", object = "-", cpu = "-", rays = "-";
    if (s.light.known) {
      share = percent(s.light.share);
      bound = percent(s.light.bound);
      object = percent(s.light.object);
    }
    if (b.facts.pilot) {
      const Cost c = costOf(s.effect, b.plan, *b.facts.pilot);
      if (c.forecast) {
        cpu = fmt::format("{:.2g} ({:.2g}-{:.2g})", c.forecast->cpu_s, c.forecast->least_s, c.forecast->most_s);
        rays = rayText(c.forecast->rays);
      } else if (c.with) {
        cpu = fmt::format("with {}", nameOf(*c.with));
      }
    }
    out += fmt::format("{:<9} {:<5} {:>8} {:>8} {:>8} {:>16} {:>8}  {}\n", nameOf(s.effect), s.run ? "run" : "skip", share, bound, object,
                       cpu, rays, s.because);
  }
  const Facts& f = b.facts;
  if (f.pilot) {
    const Json all = forecastOf(b, stages);
    out += fmt::format("\nin all: {:.2g} CPU s ({:.2g} to {:.2g}), {} rays, {}; left out: at most {} of the level, {} of an object\n",
                       double(all["cpu_seconds"]), double(all["least_cpu_seconds"]), double(all["most_cpu_seconds"]),
                       rayText(double(all["rays"])), sizeText(b.memory), percent(b.plan.leftOut), percent(b.plan.leftOutObject));
    out += fmt::format("pilot: mean {:.3g} lx, mean albedo {:.2g}, {} of rays leave the level, {} passes, {} rays in {:.2g} CPU s\n",
                       f.pilot->mean_lx * b.lightUnit, f.pilot->meanAlbedo, percent(f.pilot->openShare), f.pilot->bounces,
                       rayText(f.pilot->rays), f.pilot->cpu_s);
  }
  out += fmt::format("level: {} receivers, {} triangles cast shadows ({} with holes), {}, {}\n", f.receivers, f.blockers, f.maskedTriangles,
                     f.grey ? "grey" : "coloured", f.shape == Shape::Any ? "not convex" : shapeName(f.shape));
  if (f.pilot && !f.pilot->lamps.empty()) {
    std::vector<LampFact> lamps = f.pilot->lamps;
    std::ranges::stable_sort(lamps, std::ranges::greater{}, &LampFact::bound);
    constexpr std::size_t kShown = 8;
    out += "lamps, unshadowed:\n";
    for (std::size_t i = 0; i < std::min(kShown, lamps.size()); ++i)
      out += fmt::format("  {:<32} reaches {:>6} of the texels, {:>8} of the level's light\n", lamps[i].path, percent(lamps[i].texels),
                         percent(lamps[i].bound));
    if (lamps.size() > kShown) out += fmt::format("  and {} weaker ones\n", lamps.size() - kShown);
  }
  return out;
}

}  // namespace lmc
