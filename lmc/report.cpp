#include "lmc/report.h"

#include <algorithm>
#include <numeric>

#include "libscene/tracer.h"
#include "lmc/ao.h"
#include "lmc/outputs.h"
#include "lmc/plan_report.h"

namespace lmc {

using Json = nlohmann::ordered_json;

namespace {
Json rgb(const glm::dvec3& c) { return Json::array({c.x, c.y, c.z}); }
}  // namespace

namespace {
constexpr std::array<const char*, 5> kSolverNames{"auto", "stored", "hierarchical", "dense", "shooting"};

Json linksOf(const Bake& b) {
  const LinkStats& l = b.links;
  Json rules = Json::object();
  for (std::size_t k = 0; k < kRules; ++k) {
    const RuleCount& c = l.rules[k];
    rules[kRuleNames[k]] = {
        {"on", c.on}, {"pairs_asked", c.asked}, {"settled", c.settled}, {"rays_saved", c.raysSaved}, {"seconds", c.seconds}};
  }
  return {{"count", l.links},           {"bytes", l.bytes},         {"rays", l.rays},      {"pairs", l.pairs},
          {"rounds", l.rounds},         {"threshold", l.threshold}, {"full", l.linksFull}, {"predicted_error", l.predictedError},
          {"last_change", b.linkError}, {"partition", rules}};
}
}  // namespace

Json uvOf(const UvLayout& uv, const Scene& scene) {
  constexpr const char* kFates[] = {"none", "kept", "repaired", "made"};
  Json objects = Json::array();
  for (std::size_t i = 0; i < uv.objects.size(); ++i) {
    const ObjectUv& u = uv.objects[i];
    if (u.fate == ObjectUv::Fate::None) continue;
    const Object& o = scene.objects[i];
    Json object = {{"object", o.path},       {"uv", kFates[std::size_t(u.fate)]},    {"map", o.map},
                   {"texCoord", o.texCoord}, {"triangles", o.triangleCount},         {"area_m2", u.area_m2},
                   {"texels", u.texels},     {"texels_per_metre", u.texelsPerMetre}, {"stretch", u.stretch}};
    if (u.charts > 0) object["charts"] = u.charts;
    if (!u.because.empty()) object["because"] = u.because;
    objects.push_back(std::move(object));
  }
  return {
      {"side", uv.side},   {"maps", uv.maps}, {"efficiency", uv.efficiency}, {"charts_placed", uv.charts}, {"mean_stretch", uv.meanStretch},
      {"objects", objects}};
}
namespace {
Json seamsOf(const Bake& b) {
  const auto jump = [&b](const SeamJump& j) {
    return Json{
        {"rms_lx", b.lightUnit * j.rms}, {"largest_lx", b.lightUnit * j.largest}, {"rms", j.relativeRms}, {"largest", j.relativeLargest}};
  };
  const SeamResult& c = b.closed;
  return {{"pairs", b.seams.smooth.size()}, {"creases", b.seams.creases},
          {"samples", c.samples.size()},    {"before", jump(c.before)},
          {"after", jump(c.after)},         {"texels", c.texels},
          {"padding", c.padding},           {"texels_moved", c.moved},
          {"texels_at_limit", c.limited},   {"largest_move_lx", b.lightUnit * c.largestMove_lx},
          {"largest_move", c.largestMove},  {"rms_move", c.rmsMove}};
}
}  // namespace

namespace {
constexpr std::size_t kWorstPlaces = 8;
constexpr std::size_t kPlaceSide = 16;  // texels: one place to a block, else all would lie along one edge

Json placeOf(const Bake& b, std::size_t texel) {
  const auto side = std::size_t(b.uv.side), x = texel % side, y = texel / side;
  return {{"map", y / side},
          {"x", x},
          {"y", y % side},
          {"object", b.scene.objects[b.map.object[texel]].path},
          {"class", kTexelClassNames[std::size_t(classOf(b.map, texel))]}};
}

/// Where the map states the largest error.
Json worstOf(const Bake& b) {
  std::vector<std::pair<float, std::size_t>> blocks;  // the worst texel of each
  const auto side = std::size_t(b.uv.side), wide = (side + kPlaceSide - 1) / kPlaceSide;
  if (b.stated.size() == b.map.size() && b.map.size() > 0) {
    blocks.assign((b.map.size() / side + kPlaceSide - 1) / kPlaceSide * wide, {0.0f, 0});
    for (std::size_t i = 0; i < b.map.size(); ++i) {
      auto& worst = blocks[i / side / kPlaceSide * wide + i % side / kPlaceSide];
      if (b.stated[i] > worst.first) worst = {b.stated[i], i};
    }
  }
  std::ranges::stable_sort(blocks, [](const auto& one, const auto& other) { return one.first > other.first; });
  Json out = Json::array();
  for (const auto& [stated, texel] : blocks) {
    if (!(stated > 0.0f) || out.size() == kWorstPlaces) break;
    Json place = placeOf(b, texel);
    place["stated_lx"] = stated;
    place["stated"] = double(stated) / b.ledger.mean;
    out.push_back(std::move(place));
  }
  return out;
}

Json foundOf(const Found& f) {
  return {{"rms", f.rms()}, {"interval", {f.low(1.96), f.high(1.96)}}, {"bias", f.bias}, {"bias_error", f.biasError}};
}

Json auditOf(const Bake& b) {
  const AuditResult& a = b.audit;
  Json classes = Json::object(), worst = Json::array();
  for (std::size_t k = 0; k < a.classes.size(); ++k) {
    const AuditedClass& c = a.classes[k];
    if (c.texels == 0) continue;
    Json entry = {{"texels", c.texels}, {"drawn", c.drawn}, {"stated", c.stated}};
    entry.update(foundOf(c.found));
    classes[kTexelClassNames[k]] = std::move(entry);
  }
  for (const AuditedTexel& t : a.worst) {
    Json place = placeOf(b, t.texel);
    place.update(
        {{"illuminance_lx", t.illuminance}, {"stated_lx", t.stated}, {"difference_lx", t.found}, {"difference_error_lx", t.foundError}});
    worst.push_back(std::move(place));
  }
  Json out = {{"texels", a.drawn}, {"paths", a.paths}, {"rays", a.rays}};
  out.update(foundOf(a.found));
  out["contradicts"] = a.contradicts;
  out["classes"] = std::move(classes);
  out["worst"] = std::move(worst);
  return out;
}
}  // namespace

Json reportOf(const Bake& b, const Spoken& spoken, bool goalMet) {
  Json r;
  r["schema"] = "lmc-report/1";
  r["version"] = LMC_VERSION;
  r["plan"] = planOf(b, spoken.stages);
  r["forecast"] = forecastOf(b, spoken.stages);
  r["facts"] = factsOf(b);
  const ErrorLedger& e = b.ledger;
  r["error"] = {{"goal", b.options.goal},
                {"goal_met", goalMet},
                {"estimate", e.estimate},
                {"bound95", e.bound95},
                {"interval", {e.low, e.high}},
                {"noise", e.noise},
                {"interpolation", e.interpolation},
                {"patches", e.field},
                {"seams", e.seams},
                {"rims", e.rims},
                {"bounce_tail", e.tail},
                {"bounce_tail_estimate", e.tailEstimate},
                {"left_out", e.leftOut},
                {"left_out_object", b.plan.leftOutObject},
                {"worst_object", e.worstObject},
                {"worst_object_path", e.worstObjectId == kNone ? "" : b.scene.objects[e.worstObjectId].path}};
  r["error"]["worst"] = worstOf(b);
  if (b.audit.drawn > 0) r["error"]["audit"] = auditOf(b);
  r["error"]["gather_rounds"] = b.map.rounds;
  glm::dvec3 mean(0.0);
  double lo = 1e300, hi = 0.0;
  for (std::size_t i = 0; i < b.map.size(); ++i) {
    if (b.map.chart[i] == kNone) continue;
    const Rgb v = b.values.direct[i] + b.values.indirect[i];
    mean += glm::dvec3(v) / double(e.texels);
    lo = std::min(lo, double(std::min({v.r, v.g, v.b})));
    hi = std::max(hi, double(strength(v)));
  }
  if (b.openness.asked > 0) r["ao"] = aoOf(b.openness, b.options.ao.how);
  r["illuminance"] = {
      {"unit", "lx"}, {"mean", rgb(b.lightUnit * mean)}, {"min", e.texels > 0 ? b.lightUnit * lo : 0.0}, {"max", b.lightUnit * hi}};
  r["maps"] = Json::array();
  for (std::size_t k = 0; k < b.scales.size(); ++k)
    r["maps"].push_back({{"file", mapNames(b, "lightmap", "exr")[k]}, {"width", b.uv.side}, {"height", b.uv.side}, {"scale", b.scales[k]}});
  r["uv"] = uvOf(b.uv, b.scene);
  r["seams"] = seamsOf(b);
  r["rims"] = {{"texels", b.rimsFilled.texels}, {"largest_move_lx", b.lightUnit * b.rimsFilled.largestMove_lx}};
  r["padding"] = {{"texels", kPadding}, {"contested", b.padding.contested.size()}};
  r["texels"] = {{"covered", e.texels}, {"gathered", e.gathered}, {"all", b.map.size()}};
  std::uint64_t twoSided = 0;
  for (const Object& o : b.scene.objects) twoSided += o.receive && b.scene.materials[o.material].doubleSided ? o.triangleCount : 0;
  r["double_sided_triangles_without_light_on_their_back"] = twoSided;
  r["patches"] = {{"count", b.patches.patches.size()},     {"size_m", b.patches.size_m},
                  {"faces", b.patches.leaves.size()},      {"unjoined_triangles", b.patches.unjoined},
                  {"mean_reflectance", b.meanReflectance}, {"albedo_clamped", b.clampedPatches}};
  if (!b.patches.patches.empty()) {
    const Solution& s = b.solutions[0];
    r["solver"] = {{"method", kSolverNames[std::size_t(b.solver)]},
                   {"passes", s.passes},
                   {"stop", s.stop == Stop::Energy   ? "energy"
                            : s.stop == Stop::Passes ? "passes"
                                                     : "nothing to send"},
                   {"tail_bound", b.tail()}};
    if (b.closureError >= 0.0) r["solver"]["closure_error_before_scaling"] = b.closureError;
    if (b.solver == Solver::Stored) r["solver"]["stored_bytes"] = b.storedBytes;
    if (b.solver == Solver::Hierarchical) r["solver"]["links"] = linksOf(b);
    const Energy& g = s.energy;
    r["energy"] = {{"unit", "lm"},
                   {"sent", rgb(b.lightUnit * g.sent)},
                   {"absorbed", rgb(b.lightUnit * g.absorbed)},
                   {"back_faces", rgb(b.lightUnit * g.backs)},
                   {"left_the_level", rgb(b.lightUnit * g.left)},
                   {"unsent", rgb(b.lightUnit * g.unsent)},
                   {"balance", g.imbalance()}};
  } else {
    r["energy"] = {{"balance", 0.0}};
  }
  Json rays;
  rays["total"] = b.occlusionRaysBefore + (b.tracer ? b.tracer->rays() : 0);
  rays["pilot"] = std::accumulate(b.pilotRays.begin(), b.pilotRays.end(), std::uint64_t(0));
  for (std::size_t p = 0; p < kPurposeNames.size(); ++p)
    rays[kPurposeNames[p]] =
        (b.tracer ? b.tracer->rays(Purpose(p)) - b.pilotRays[p] : 0) + (Purpose(p) == Purpose::Occlusion ? b.occlusionRaysBefore : 0);
  r["rays"] = rays;
  r["alpha_tests"] = b.tracer ? b.tracer->holeTests() : 0;
  // Seconds by light: the direct stage's, by rays.
  double directSeconds = 0.0;
  for (const StageTime& t : spoken.stages) directSeconds += t.name == "direct" ? t.seconds : 0.0;
  const double shadowRays = std::max(1.0, double(rays["shadow"]) + double(rays["emitter"]));
  Json lights = Json::array();
  const auto addLight = [&](const std::string& path, const char* kind, std::uint64_t count) {
    lights.push_back({{"light", path}, {"kind", kind}, {"rays", count}, {"seconds", directSeconds * double(count) / shadowRays}});
  };
  if (b.direct) {
    constexpr const char* kKinds[] = {"point", "spot", "directional"};
    for (std::uint32_t i = 0; i < b.scene.lights.size(); ++i)
      addLight(b.scene.lights[i].path, kKinds[std::size_t(b.scene.lights[i].kind)], b.direct->raysOf(i));
    if (b.direct->hasEmitters()) addLight("emissive surfaces", "area", rays["emitter"]);
  }
  r["lights"] = lights;
  if (!b.explained.is_null()) r["explain"] = b.explained;
  Json stages = Json::array();
  double seconds = 0.0, cpu = 0.0;
  for (const StageTime& t : spoken.stages) {
    stages.push_back({{"name", t.name}, {"seconds", t.seconds}, {"cpu_seconds", t.cpuSeconds}, {"rays", t.rays}, {"summary", t.summary}});
    seconds += t.seconds;
    cpu += t.cpuSeconds;
  }
  r["stages"] = stages;
  r["seconds"] = seconds;
  r["cpu_seconds"] = cpu;
  r["peak_memory_bytes"] = peakBytes();
  r["memory"] = {{"limit_bytes", b.memory.limit_bytes}, {"least_bytes", b.memory.least_bytes}, {"compact", b.memory.paged()}};
  Json warnings = Json::array(), notes = Json::array();
  for (const Message& m : spoken.messages)
    (m.level == Message::Level::Warning ? warnings : notes).push_back({{"where", m.where}, {"text", m.text}, {"code", m.code}});
  r["warnings"] = warnings;
  r["notes"] = notes;
  return r;
}

}  // namespace lmc
