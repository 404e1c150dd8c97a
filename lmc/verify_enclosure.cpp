/// Reference cases of enclosures.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "libradiosity/endless.h"
#include "libradiosity/form_factor_bodies.h"
#include "libradiosity/lights.h"
#include "libradiosity/zonal.h"
#include "libscene/constants.h"
#include "lmc/verify_case.h"
#include "lmc/verify_pipeline.h"
#include "lmc/verify_room.h"

namespace lmc {

namespace {

constexpr double kLampRadianceOfExitance = 1.0 / kPi;

/// Emission and albedo of each zone.
struct Zones {
  std::vector<long double> emission, albedo;
};

Zones zonesOf(const Parameters& g, std::size_t count) {
  Zones z{g["emission"].extendeds(), g["albedo"].extendeds()};
  if (z.emission.size() != count) g["emission"].broken("has not one entry for each surface");
  if (z.albedo.size() != count) g["albedo"].broken("has not one entry for each surface");
  for (const long double a : z.albedo)
    if (a < 0.0L || a > 1.0L) g["albedo"].broken("is no share");
  return z;
}

/// B1, B2 and factors of two surfaces, the first of which sees the second alone.
Evaluate twoSurfaces(const Zones& z, long double outerToInner, long double outerToOuter) {
  const long double factors[4] = {0.0L, 1.0L, outerToInner, outerToOuter};
  const ZonalSolution s = solveZonal(factors, z.emission, z.albedo);
  const std::vector<std::pair<std::string, double>> values{{"B1", double(s.radiosity[0])},
                                                           {"B2", double(s.radiosity[1])},
                                                           {"H1", double(s.illuminance[0])},
                                                           {"H2", double(s.illuminance[1])},
                                                           {"F12", 1.0},
                                                           {"F21", double(outerToInner)},
                                                           {"F22", double(outerToOuter)}};
  return [=](const Wanted& w) -> std::optional<Got> {
    for (const auto& [name, value] : values)
      if (w.name == name) return Got{value};
    return std::nullopt;
  };
}

Evaluate concentric(const Parameters& g, int dimensions) {
  const long double r1 = g["r1"].extended(), r2 = g["r2"].extended();
  if (!(r1 > 0.0L && r2 > r1)) g["r2"].broken("is not above 'r1'");
  const ConcentricFactors f = concentricFactors(r1, r2, dimensions);
  return twoSurfaces(zonesOf(g, 2), f.outerToInner, f.outerToOuter);
}

Evaluate concentricSpheres(const Parameters& g, const VerifyContext&) { return concentric(g, 2); }
Evaluate coaxialCylinders(const Parameters& g, const VerifyContext&) { return concentric(g, 1); }
Evaluate endlessPlates(const Parameters& g, const VerifyContext&) { return twoSurfaces(zonesOf(g, 2), 1.0L, 0.0L); }

/// What leaves any place of a sphere's inside reaches all places alike: F_ij = share of the area of j.
Evaluate integratingSphere(const Parameters& g, const VerifyContext&) {
  const Parameters parts = g["parts"];
  const std::size_t n = parts.size();
  Zones z;
  std::vector<long double> factors;
  for (std::size_t i = 0; i < n; ++i) {
    z.emission.push_back(parts.at(i)["emission"].extended());
    z.albedo.push_back(parts.at(i)["albedo"].extended());
  }
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j) factors.push_back(parts.at(j)["area_share"].extended());
  const ZonalSolution s = solveZonal(factors, z.emission, z.albedo);
  return [=](const Wanted& w) -> std::optional<Got> {
    if (w.name == "H" && n > 0) return Got{double(s.illuminance[0])};
    if (const auto i = indexOf(w.name, "B", n)) return Got{double(s.radiosity[*i])};
    return std::nullopt;
  };
}

Evaluate zonalBox(const Parameters& g, const VerifyContext&) {
  const glm::dvec3 size = g["size"].vec3();
  const Zones z = zonesOf(g, 6);
  const std::vector<std::size_t> order = facesOf(g);  // the case's i-th face among ours
  const std::vector<long double> box = boxFactors(size.x, size.y, size.z);
  std::vector<long double> factors(36);
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t j = 0; j < 6; ++j) factors[i * 6 + j] = box[order[i] * 6 + order[j]];
  const ZonalSolution s = solveZonal(factors, z.emission, z.albedo);
  return [=](const Wanted& w) -> std::optional<Got> {
    if (const auto i = indexOf(w.name, "B", 6)) return Got{double(s.radiosity[*i])};
    if (const auto i = indexOf(w.name, "H", 6)) return Got{double(s.illuminance[*i])};
    if (w.name.size() == 3 && w.name[0] == 'F' && w.name[1] >= '0' && w.name[1] < '6' && w.name[2] >= '0' && w.name[2] < '6')
      return Got{double(factors[std::size_t(w.name[1] - '0') * 6 + std::size_t(w.name[2] - '0')])};
    return std::nullopt;
  };
}

// ---- endless in one direction ---------------------------------------------------------------------------------------

/// The finest of several numbers of panels; what the step before it made of the value is its standard error.
Got refined(const std::vector<Strip>& strips, double standardError, const std::function<double(const EndlessEnclosure&)>& of) {
  constexpr std::size_t kMostUnknowns = 1024;
  Got got{0.0, Way::Sampled, 0.0, 0.0};
  double before = of(EndlessEnclosure(strips, 16));
  for (int panels = 32; std::size_t(panels) * strips.size() <= kMostUnknowns; panels *= 2) {
    got.value = of(EndlessEnclosure(strips, panels));
    got.standardError = std::abs(got.value - before);
    if (panels >= 64 && got.standardError <= standardError) break;
    before = got.value;
  }
  got.rounding = 1e-12 * std::abs(got.value);  // of the solver itself
  return got;
}

/// "H1_mean", "H2_middle", "H1_edge", "H2_at_50%", "H_mean[3]", "H_middle[0]".
Evaluate stripValues(const std::vector<Strip>& strips, const std::vector<bool>& fromEdge) {
  return [=](const Wanted& w) -> std::optional<Got> {
    for (std::size_t s = 0; s < strips.size(); ++s) {
      const std::string one = fmt::format("H{}_", s + 1), many = fmt::format("[{}]", s);
      std::string what;
      if (w.name.starts_with(one)) what = w.name.substr(one.size());
      if (w.name.starts_with("H_") && w.name.ends_with(many)) what = w.name.substr(2, w.name.size() - 2 - many.size());
      if (what.empty()) continue;
      double share = 0.5;
      if (what == "mean") return refined(strips, w.standardError, [=](const EndlessEnclosure& e) { return e.mean(s); });
      if (what == "edge") {
        share = 0.0;
      } else if (what.starts_with("at_") && what.ends_with("%")) {
        const nlohmann::json text = what.substr(3, what.size() - 4);
        share = Parameters(text, "", w.name).number() / 100.0;
      } else if (what != "middle") {
        return std::nullopt;
      }
      if (!fromEdge[s]) share = 1.0 - share;
      return refined(strips, w.standardError, [=](const EndlessEnclosure& e) { return e.at(s, share); });
    }
    return std::nullopt;
  };
}

Strip strip(glm::dvec2 from, glm::dvec2 to, const Zones& z, std::size_t i) {
  return {from, to, double(z.emission[i]), double(z.albedo[i])};
}

Evaluate strips2d(const Parameters& g, const VerifyContext&) {
  const Zones z = zonesOf(g, 2);
  const double w = g.number("width"), gap = g.number("gap");
  return stripValues({strip({0, 0}, {w, 0}, z, 0), strip({w, gap}, {0, gap}, z, 1)}, {true, true});
}

Evaluate corner2d(const Parameters& g, const VerifyContext&) {
  const Zones z = zonesOf(g, 2);
  const double a = g.number("angle_deg"), w1 = g.number("width1"), w2 = g.number("width2");
  const glm::dvec2 end(w2 * cosDegrees(a), w2 * sinDegrees(a));
  return stripValues({strip({0, 0}, {w1, 0}, z, 0), strip(end, {0, 0}, z, 1)}, {true, false});
}

Evaluate tube2d(const Parameters& g, const VerifyContext&) {
  if (g.has("sides") && g["sides"].json() != nlohmann::json({"bottom", "right", "top", "left"})) throw LeftOut{"sides of another order"};
  const Zones z = zonesOf(g, 4);
  const double a = g.number("side");
  return stripValues({strip({0, 0}, {a, 0}, z, 0), strip({a, 0}, {a, a}, z, 1), strip({a, a}, {0, a}, z, 2), strip({0, a}, {0, 0}, z, 3)},
                     {true, true, true, true});
}

// ---- by a whole bake ------------------------------------------------------------------------------------------------

BakeSceneOptions bakeOptions(double patchSize_m, int cells) {
  BakeSceneOptions o;
  o.side = 20 * cells;  // margins of a tenth are whole texels
  o.raysPerPlace = 16384;
  o.patchSize_m = patchSize_m;
  return o;
}

Evaluate furnaceRoom(const Parameters& g, const VerifyContext& context) {
  const long double albedo = g["albedo"].extended(), emission = g["emission"].extended();
  const glm::dvec3 size(3, 2, 4);
  const double unit = double(emission);
  BakeSceneOptions o = bakeOptions(2.0, 4);
  o.side = 40;  // the light is even: a coarse map knows it as well
  const auto bakes = std::make_shared<Bakes>(furnace(float(albedo), float(kLampRadianceOfExitance)), o, context);
  const double areas[6] = {size.y * size.z, size.y * size.z, size.x * size.z, size.x * size.z, size.x * size.y, size.x * size.y};
  const std::vector<double> weights(areas, areas + 6);
  return [=](const Wanted& w) -> std::optional<Got> {
    if (w.name == "series_terms_to_1e-3") return Got{seriesTerms(albedo, 1e-3L)};
    if (w.name != "H" && w.name != "B") return std::nullopt;
    const double rho = w.name == "B" ? double(albedo) : 1.0, own = w.name == "B" ? 1.0 : 0.0;
    Got got = bakes->value(w.standardError / unit, [&](const Baked& b) { return own + rho * meanOver(b, weights); });
    got.value *= unit;
    got.standardError *= unit;
    got.rounding *= unit;
    return got;
  };
}

/// A closed room of unlike walls with a box in it: what is absorbed over what is sent.
Evaluate identity(const Parameters&, const VerifyContext& context) {
  const auto room = std::make_shared<BalanceRoom>(balanceRoom());
  BakeSceneOptions o = bakeOptions(1.0, 4);
  o.side = 40;  // a mean over the whole room needs no fine texels
  const auto bakes = std::make_shared<Bakes>(room->scene, o, context);
  return [=](const Wanted& w) -> std::optional<Got> {
    if (w.name != "sum A (1-rho) H over sum A E") return std::nullopt;
    return bakes->value(w.standardError, [&](const Baked& b) { return absorbed(*room, b) / room->sent; });
  };
}

Evaluate interreflection(const Parameters& g, const VerifyContext& context) {
  const double side = g.number("side"), flux = g.number("flux"), albedo = g.number("albedo");
  SceneBuilder b;
  const std::uint32_t m = b.material(Rgb(float(albedo)));
  const float half = float(0.5 * side);
  b.room(glm::vec3(-half), glm::vec3(half), {m, m, m, m, m, m});
  Light l;
  l.intensity = Rgb(1.0f);
  l.path = "/lamp";
  b.scene.lights.push_back(l);
  const double unit = flux / (4.0 * kPi);
  const auto bakes = std::make_shared<Bakes>(b.scene, bakeOptions(side / 4.0, 4), context);
  return [=](const Wanted& w) -> std::optional<Got> {
    const bool total = w.name == "E_total_mean";
    if (!total && w.name != "E_indirect_mean") return std::nullopt;
    Got got = bakes->value(w.standardError / unit, [&](const Baked& baked) {
      double sum = 0.0;
      for (std::uint32_t f = 0; f < 6; ++f) sum += (total ? baked.mean(f) : baked.meanIndirect(f)).x / 6.0;
      return sum;
    });
    got.value *= unit;
    got.standardError *= unit;
    got.rounding *= unit;
    return got;
  };
}

Evaluate interreflectionDirect(const Parameters& g, const VerifyContext&) {
  const double half = 0.5 * g.number("side"), flux = g.number("flux");
  const std::vector<double> at = g["point_on_face"].numbers();
  if (at.size() != 2) g["point_on_face"].broken("is not two numbers");
  Light l;
  l.intensity = Rgb(1.0f);
  const double e = flux / (4.0 * kPi) * incoming(l, {at[0], at[1], -half}, {0, 0, 1}).illuminance.x;
  return [=](const Wanted& w) { return w.name == "E_direct" ? std::optional(Got{e}) : std::nullopt; };
}

Evaluate squarePlates(const Parameters& g, const VerifyContext& context) {
  const Zones z = zonesOf(g, 2);
  const float a = float(g.number("side")), gap = float(g.number("gap"));
  SceneBuilder b(4);
  for (std::size_t i = 0; i < 2; ++i) b.material(Rgb(float(z.albedo[i])), Rgb(float(double(z.emission[i]) * kLampRadianceOfExitance)));
  const glm::vec3 X(a, 0, 0), Y(0, a, 0);
  b.quad(glm::vec3(0), X, Y, 0);
  b.quad(glm::vec3(0, 0, gap), Y, X, 1);
  BakeSceneOptions o = bakeOptions(double(a) / 4.0, 4);
  for (std::uint32_t i = 0; i < 2; ++i) {
    o.places.push_back({i, 0.5, 0.5});
    o.places.push_back({i, 0.0, 0.0});
    o.places.push_back({i, 0.5, 0.0});
  }
  const auto bakes = std::make_shared<Bakes>(b.scene, o, context);
  return [=](const Wanted& w) -> std::optional<Got> {
    for (std::uint32_t i = 0; i < 2; ++i) {
      const std::string stem = fmt::format("H{}_", i + 1);
      if (!w.name.starts_with(stem)) continue;
      const std::string what = w.name.substr(stem.size());
      if (what == "mean") return bakes->value(w.standardError, [&](const Baked& k) { return k.mean(i).x; });
      const std::pair<const char*, std::size_t> places[] = {{"centre", 0}, {"corner", 1}, {"edge", 2}};
      for (const auto& [name, place] : places)
        if (what == name) return bakes->value(w.standardError, [&](const Baked& k) { return k.places[3 * i + place].x; });
    }
    return std::nullopt;
  };
}

Evaluate trueCube(const Parameters& g, const VerifyContext& context) {
  const auto cube = std::make_shared<Cube>(cubeOf(g));
  BakeSceneOptions o = bakeOptions(cube->side / 4.0, cube->cells);
  o.places = cube->centres;
  const auto bakes = std::make_shared<Bakes>(cube->scene, o, context);
  return [=](const Wanted& w) -> std::optional<Got> {
    if (const auto i = indexOf(w.name, "H_mean", 6))
      return bakes->value(w.standardError, [&](const Baked& b) { return meanOver(b, cube->areas[*i]); });
    if (const auto i = indexOf(w.name, "H_centre", 6)) return bakes->value(w.standardError, [&](const Baked& b) { return b.places[*i].x; });
    return std::nullopt;
  };
}

}  // namespace

std::vector<CaseKind> enclosureKinds() {
  return {{"enclosure/furnace", furnaceRoom},
          {"enclosure/integrating_sphere", integratingSphere},
          {"enclosure/concentric_spheres", concentricSpheres},
          {"enclosure/coaxial_cylinders", coaxialCylinders},
          {"enclosure/infinite_plates", endlessPlates},
          {"enclosure/identity", identity},
          {"enclosure/zonal_box", zonalBox},
          {"enclosure/strips2d", strips2d},
          {"enclosure/corner2d", corner2d},
          {"enclosure/tube2d", tube2d},
          {"enclosure/square_plates", squarePlates},
          {"enclosure/true_cube", trueCube},
          {"cie/interreflection", interreflection},
          {"cie/interreflection_direct", interreflectionDirect}};
}

}  // namespace lmc
