#include "lmc/explain.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "libradiosity/gather.h"
#include "libradiosity/lights.h"
#include "libscene/constants.h"
#include "libscene/sampling.h"

namespace lmc {

using Json = nlohmann::ordered_json;

namespace {

constexpr std::uint32_t kPlaces = 64;    // of the texel, for lamps and emitters
constexpr std::uint32_t kRays = 4096;    // over its hemisphere
constexpr std::size_t kShown = 8;        // surfaces that send light, things in the way
constexpr std::uint32_t kStream = 0xe7;  // of random numbers: apart from those of the bake

Json vector(const glm::dvec3& c) { return Json::array({c.x, c.y, c.z}); }
Json lux(const Bake& b, const glm::dvec3& c) { return vector(b.lightUnit * c); }
double mean3(const glm::dvec3& c) { return (c.x + c.y + c.z) / 3.0; }

/// Rays that met each object.
using Met = std::map<std::uint32_t, double>;
Json blockersOf(const Bake& b, const Met& met, double rays) {
  std::vector<std::pair<std::uint32_t, double>> order(met.begin(), met.end());
  std::ranges::stable_sort(order, [](const auto& a, const auto& c) { return a.second > c.second; });
  Json out = Json::array();
  for (std::size_t i = 0; i < std::min(kShown, order.size()); ++i)
    out.push_back({{"object", b.scene.objects[order[i].first].path}, {"share", order[i].second / rays}});
  return out;
}

class ExplainedTexel {
 public:
  ExplainedTexel(const Bake& b, std::size_t index)
      : b_(b),
        x_(int(index % std::size_t(b.map.width))),
        y_(int(index / std::size_t(b.map.width))),
        tile_(b.texels->texels(std::size_t(y_ / kTile) * std::size_t(b.texels->tilesX()) + std::size_t(x_ / kTile))),
        sampler_(b.scene, tile_, tile_.at(x_ % kTile, y_ % kTile)),
        numbers_(sequence(b.run.seed, Draw::Direct, 0, 0, std::uint32_t(x_), std::uint32_t(y_), kStream)) {
    for (std::uint32_t k = 0; k < kPlaces; ++k) {
      const glm::vec4 u = numbers_.point(k);
      places_.push_back(sampler_.at({u.z, u.w}));
    }
  }

  SurfacePoint middle() const { return sampler_.middle(); }
  double coverage() const { return double(tile_.at(x_ % kTile, y_ % kTile).coverage); }

  /// Every lamp that would shine here if nothing blocked it, and the number of all others.
  Json lamps(std::size_t& others) const {
    constexpr const char* kKinds[] = {"point", "spot", "directional"};
    Json out = Json::array();
    for (std::uint32_t l = 0; l < b_.scene.lights.size(); ++l) {
      glm::dvec3 unblocked(0.0), given(0.0);
      Met met;
      double rays = 0.0;
      for (const SurfacePoint& p : places_) {
        const Incoming in = incoming(b_.scene.lights[l], p.position_m, p.normal);
        if (in.illuminance == glm::dvec3(0.0) || glm::dot(in.towards, p.geometricNormal) <= 0.0) continue;
        unblocked += in.illuminance / double(kPlaces);
        rays += 1.0;
        const Hit hit = b_.plan.runs(Effect::Shadow) ? firstHit(p, in) : Hit{};
        if (hit)
          met[b_.scene.triangleObject[hit.triangle]] += 1.0;
        else
          given += in.illuminance / double(kPlaces);
      }
      if (unblocked == glm::dvec3(0.0)) {
        ++others;
        continue;
      }
      out.push_back({{"light", b_.scene.lights[l].path},
                     {"kind", kKinds[std::size_t(b_.scene.lights[l].kind)]},
                     {"illuminance", lux(b_, given)},
                     {"unblocked", lux(b_, unblocked)},
                     {"blocked_by", blockersOf(b_, met, rays)}});
    }
    return out;
  }

  /// Emissive objects.
  Json emitters() const {
    std::map<std::uint32_t, std::vector<std::uint32_t>> byObject;
    const auto& whole = b_.direct->emitters().whole;
    for (std::uint32_t e = 0; e < whole.size(); ++e) byObject[b_.scene.triangleObject[whole[e].triangle]].push_back(e);
    Json out = Json::array();
    for (const auto& [object, ids] : byObject) {
      const DirectPart part = b_.direct->emitters(places_, ids, numbers_);
      if (part.unshadowed == glm::dvec3(0.0)) continue;
      out.push_back(
          {{"object", b_.scene.objects[object].path}, {"illuminance", lux(b_, part.illuminance)}, {"unblocked", lux(b_, part.unshadowed)}});
    }
    return out;
  }

  /// The sky, and surfaces by what they send here.
  void hemisphere(Json& sky, Json& surfaces) const {
    double left = 0.0;
    std::map<std::uint32_t, std::pair<glm::dvec3, double>> from;
    const Sobol4 directions = sequence(b_.run.seed, Draw::Hemisphere, 0, 0, std::uint32_t(x_), std::uint32_t(y_), kStream);
    for (std::uint32_t k = 0; k < kRays; ++k) {
      const glm::vec4 u = directions.point(k);
      const SurfacePoint p = sampler_.at({u.z, u.w});
      const glm::dvec3 d = frameAbout(p.normal) * cosineHemisphere({u.x, u.y});
      if (glm::dot(d, p.geometricNormal) <= 0.0) continue;
      const Hit hit = b_.tracer->closest({b_.tracer->lifted(p.position_m, p.geometricNormal), glm::vec3(d), INFINITY}, Purpose::Gather);
      if (!hit) {
        left += 1.0 / double(kRays);
        continue;
      }
      auto& [light, share] = from[b_.scene.triangleObject[hit.triangle]];
      share += 1.0 / double(kRays);
      if (b_.field) light += 0.5 * glm::dvec3(b_.field->at(hit, 0).exitance + b_.field->at(hit, 1).exitance) / double(kRays);
    }
    sky = {{"share", left}, {"illuminance", lux(b_, kPi * left * glm::dvec3(b_.scene.sky))}};
    std::vector<std::pair<std::uint32_t, std::pair<glm::dvec3, double>>> order(from.begin(), from.end());
    std::ranges::stable_sort(order, [](const auto& a, const auto& c) { return mean3(a.second.first) > mean3(c.second.first); });
    surfaces = Json::array();
    for (std::size_t i = 0; i < std::min(kShown, order.size()); ++i)
      surfaces.push_back({{"object", b_.scene.objects[order[i].first].path},
                          {"illuminance", lux(b_, order[i].second.first)},
                          {"share_of_view", order[i].second.second}});
  }

 private:
  Hit firstHit(const SurfacePoint& p, const Incoming& in) const {
    const glm::vec3 from = b_.tracer->lifted(p.position_m, p.geometricNormal);
    const float end = in.endless ? INFINITY : float(std::max(0.0, 1.0 - 2.0 * double(b_.tracer->lift_m()) / glm::length(in.towards)));
    return b_.tracer->closest({from, glm::vec3(in.towards), end}, Purpose::Shadow);
  }

  const Bake& b_;
  int x_, y_;
  const TexelTile tile_;
  const TexelSampler sampler_;
  Sobol4 numbers_;
  std::vector<SurfacePoint> places_;
};

std::string colour(const Json& c) { return fmt::format("{:9.4g} {:9.4g} {:9.4g} lx", double(c[0]), double(c[1]), double(c[2])); }
std::string percent(const Json& share) { return fmt::format("{:.3g} %", 100.0 * double(share)); }

std::size_t indexOf(const Bake& b) {
  const auto [x, y, map] = *b.options.explain;
  return (std::size_t(map) * std::size_t(b.uv.side) + std::size_t(y)) * std::size_t(b.map.width) + std::size_t(x);
}

}  // namespace

Json explainTexel(const Bake& b) {
  const auto [x, y, map] = *b.options.explain;
  if (x >= b.uv.side || y >= b.uv.side || map >= b.uv.maps)
    throw Error(Exit::Usage, "lmc", "",
                fmt::format("--explain {},{},{}: the level has {} of {} x {} texels", x, y, map,
                            b.uv.maps == 1 ? "a map" : fmt::format("{} maps", b.uv.maps), b.uv.side, b.uv.side));
  const std::size_t i = indexOf(b);
  if (b.map.chart[i] == kNone)
    throw Error(Exit::Usage, "lmc", "", fmt::format("--explain {},{},{}: no chart covers that texel", x, y, map));
  const ExplainedTexel texel(b, i);
  const SurfacePoint p = texel.middle();
  Json out = {{"texel", {x, y, map}},
              {"object", b.scene.objects[b.map.object[i]].path},
              {"position_m", vector(p.position_m + b.scene.centre_m)},
              {"normal", vector(p.normal)},
              {"coverage", texel.coverage()},
              {"hemisphere_rays", 2 * std::uint64_t(b.map.rays[i])}};
  if (!b.tracer || !b.direct) return out;
  std::size_t others = 0;
  out["lamps"] = texel.lamps(others);
  out["lamps_that_do_not_reach_it"] = others;
  out["emitters"] = texel.emitters();
  texel.hemisphere(out["sky"], out["surfaces"]);
  return out;
}

void addValues(Json& explained, const Bake& b) {
  const std::size_t i = indexOf(b);
  explained["direct"] = lux(b, glm::dvec3(b.values.direct[i]));
  explained["indirect"] = lux(b, glm::dvec3(b.values.indirect[i]));
  explained["standard_error"] = lux(b, glm::dvec3(b.values.error[i]));
}

std::string explainText(const Json& e) {
  const Json& p = e["position_m"];
  std::string out =
      fmt::format("texel {}, {} of map {}: {} at {:.4g}, {:.4g}, {:.4g} m, {} covered, {}\n", int(e["texel"][0]), int(e["texel"][1]),
                  int(e["texel"][2]), std::string(e["object"]), double(p[0]), double(p[1]), double(p[2]), percent(e["coverage"]),
                  e["hemisphere_rays"] == 0 ? "interpolated" : fmt::format("{} hemisphere rays", std::uint64_t(e["hemisphere_rays"])));
  for (const char* what : {"direct", "indirect", "standard_error"})
    if (e.contains(what)) out += fmt::format("  {:<32} {}\n", what, colour(e[what]));
  if (!e.contains("lamps")) return out;
  for (const Json& l : e["lamps"]) {
    out += fmt::format("  {:<32} {}  of {}", fmt::format("{} {}", std::string(l["kind"]), std::string(l["light"])),
                       colour(l["illuminance"]), colour(l["unblocked"]));
    for (const Json& m : l["blocked_by"]) out += fmt::format(", {} behind {}", percent(m["share"]), std::string(m["object"]));
    out += "\n";
  }
  if (e["lamps_that_do_not_reach_it"] > 0)
    out += fmt::format("  {} lamps do not reach it\n", std::uint64_t(e["lamps_that_do_not_reach_it"]));
  for (const Json& l : e["emitters"])
    out += fmt::format("  {:<32} {}  of {}\n", "emitter " + std::string(l["object"]), colour(l["illuminance"]), colour(l["unblocked"]));
  out += fmt::format("  {:<32} {}, {} of the view\n", "sky", colour(e["sky"]["illuminance"]), percent(e["sky"]["share"]));
  for (const Json& s : e["surfaces"])
    out += fmt::format("  {:<32} {}, {} of the view\n", "from " + std::string(s["object"]), colour(s["illuminance"]),
                       percent(s["share_of_view"]));
  return out;
}

}  // namespace lmc
