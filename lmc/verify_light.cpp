/// Reference cases of attenuation and of illuminance from lamps.
#include <cmath>
#include <memory>

#include "libradiosity/direct.h"
#include "libradiosity/form_factor_bodies.h"
#include "libradiosity/lights.h"
#include "libscene/constants.h"
#include "libscene/scene_builder.h"
#include "lmc/verify_case.h"

namespace lmc {

namespace {

using V = glm::dvec3;

constexpr int kLeastScrambles = 16, kMostScrambles = 16384;
constexpr std::size_t kRays = 256;  // of each scramble

Evaluate one(std::string name, double value) {
  return [=](const Wanted& w) { return w.name == name ? std::optional(Got{value}) : std::nullopt; };
}

struct Element {
  V position{0.0}, normal{0.0, 0.0, 1.0};
};

/// At the origin, facing +z, when the case does not say.
Element elementOf(const Parameters& g) {
  Element e;
  if (!g.has("element")) return e;
  e.position = g["element"]["p"].vec3();
  const V n = g["element"]["n"].vec3();
  if (!(glm::length(n) > 0.0)) g["element"]["n"].broken("is no direction");
  e.normal = glm::normalize(n);
  return e;
}

ClassicAttenuation attenuationOf(const Parameters& g) {
  ClassicAttenuation a;
  a.constant = g.numberOr("constant", 1.0);
  a.linear = g.numberOr("linear", 0.0);
  a.quadratic = g.numberOr("quadratic", 0.0);
  if (g.has("window")) {
    a.range = g["window"].number("range");
    a.power = g["window"].numberOr("power", a.power);
  }
  return a;
}

Evaluate distanceAttenuation(const Parameters& g, const VerifyContext&) {
  return one("attenuation", attenuation(attenuationOf(g), g.number("distance")));
}

/// Of 1 cd (classic: of colour 1): the case's intensity is a factor in double, a light's is stored as float.
Light unitLight(const Parameters& g) {
  Light l;
  l.position_m = g["position"].vec3();
  l.intensity = Rgb(1.0f);
  return l;
}

double illuminance(const Light& light, const Element& e) { return incoming(light, e.position, e.normal).illuminance.x; }

Evaluate point(const Parameters& g, const VerifyContext&) {
  return one("E", g.number("intensity") * illuminance(unitLight(g), elementOf(g)));
}

Evaluate pointAttenuated(const Parameters& g, const VerifyContext&) {
  Light l = unitLight(g);
  l.classic = attenuationOf(g);
  return one("E", g.number("intensity") / kPi * illuminance(l, elementOf(g)));  // a classic colour is E/pi
}

Evaluate pointTexelMean(const Parameters& g, const VerifyContext&) {
  const Parameters t = g["texel"];
  const std::vector<double> x = t["x"].numbers(), y = t["y"].numbers();
  if (x.size() != 2 || y.size() != 2 || !(x[0] < x[1]) || !(y[0] < y[1])) t.broken("'x' and 'y' are no ranges");
  const double z = t.number("z");
  const V n = t.has("n") ? t["n"].vec3() : V(0, 0, 1);
  if (n.x != 0.0 || n.y != 0.0 || n.z == 0.0) throw LeftOut{"texels face +z or -z"};
  Polygon3 p{V(x[0], y[0], z), V(x[1], y[0], z), V(x[1], y[1], z), V(x[0], y[1], z)};
  if (n.z < 0.0) p = Polygon3(p.rbegin(), p.rend());
  const Light l = unitLight(g);
  const double intensity = g.number("intensity");
  const double mean = intensity * meanOfPointLight(l.position_m, p);
  const double centre = intensity * illuminance(l, {V(0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]), z), glm::normalize(n)});
  return [=](const Wanted& w) -> std::optional<Got> {
    if (w.name == "E_mean") return Got{mean};
    if (w.name == "E_centre") return Got{centre};
    return std::nullopt;
  };
}

Evaluate spot(const Parameters& g, const VerifyContext&) {
  const double inner = g.angle_rad("inner_cone"), outer = g.angle_rad("outer_cone"), intensity = g.number("intensity");
  const Light l = unitLight(g);
  const Element e = elementOf(g);
  const V axis = glm::normalize(g["direction"].vec3()), way = e.position - l.position_m;
  const double angle = std::atan2(glm::length(glm::cross(axis, way)), glm::dot(axis, way));
  const double cone = spotConeByAngle(angle, inner, outer);
  return [=](const Wanted& w) -> std::optional<Got> {
    if (w.name == "E") return Got{intensity * cone * illuminance(l, e)};
    if (w.name == "flux") return Got{intensity * spotFlux_lm(inner, outer)};
    return std::nullopt;
  };
}

Evaluate directional(const Parameters& g, const VerifyContext&) {
  Light l;
  l.kind = Light::Kind::Directional;
  l.intensity = Rgb(1.0f);
  const double a = g.number("angle_deg");
  l.direction = -V(sinDegrees(a), 0, cosDegrees(a));
  return one("E", g.number("normal_irradiance") * illuminance(l, {}));
}

Evaluate sunEdge(const Parameters& g, const VerifyContext&) {
  return one("visible_fraction", sunBesideEdge(g.angle_rad("angular_radius"), g.number("edge_offset")));
}

Evaluate sphere(const Parameters& g, const VerifyContext&) {
  const Element e = elementOf(g);
  return one("E", g.number("radiosity") * elementToSphere(e.position, e.normal, g["centre"].vec3(), g.number("radius")));
}

Evaluate disc(const Parameters& g, const VerifyContext&) {
  const Element e = elementOf(g);
  return one("E", g.number("radiosity") *
                      elementToRoundDisc(e.position, e.normal, g["centre"].vec3(), glm::normalize(g["normal"].vec3()), g.number("radius")));
}

Evaluate polygonEmitter(const Parameters& g, const VerifyContext&) {
  const Element e = elementOf(g);
  return one("E", g.number("radiosity") * elementToPolygon(e.position, e.normal, g["polygon"].polygon()));
}

Evaluate areaSource(const Parameters& g, const VerifyContext&) {
  Element e;
  e.position = g["point"].vec3();
  if (g.has("normal")) e.normal = glm::normalize(g["normal"].vec3());
  return one("E", g.numberOr("radiosity", 1.0) * elementToPolygon(e.position, e.normal, g["panel"].polygon()));
}

Evaluate diffusePlate(const Parameters& g, const VerifyContext&) {
  const Element e = elementOf(g);
  return one("E/(rho E_plate)", elementToPolygon(e.position, e.normal, g["plate"].polygon()));
}

/// A lamp of exitance 1 and something in front of it, as a level: E by the direct light of a bake.
class ShadowedLamp {
 public:
  ShadowedLamp(const Polygon3& lamp, const Polygon3& blocker) {
    SceneBuilder b;
    b.polygon(lamp, b.material(Rgb(0.0f), Rgb(1.0f)));
    b.polygon(blocker, b.material(Rgb(0.0f)));
    scene_ = b.scene;
    tracer_ = std::make_unique<Tracer>(scene_);
    direct_ = std::make_unique<DirectLight>(scene_, *tracer_, true);
  }
  /// `index` tells the places of a case apart.
  Got at(const Element& e, double standardError, std::uint64_t seed, std::uint32_t index) const {
    SurfacePoint p;
    p.position_m = e.position;
    p.normal = p.geometricNormal = e.normal;
    const std::vector<SurfacePoint> same(kRays, p);
    Got got = sampleUntil(standardError, kLeastScrambles, kMostScrambles, [&](int k) {
      return direct_->sample(same, direct_->lightsFor(p.position_m, 0.0), sequence(seed, Draw::Direct, 0, 0, index, 0, std::uint32_t(k)))
                 .illuminance.x /
             kPi;
    });
    got.rounding = kFloatStorage * got.value;
    return got;
  }

 private:
  static constexpr double kFloatStorage = 1e-6;  // vertices are floats: some 10 ulp
  Scene scene_;
  std::unique_ptr<Tracer> tracer_;
  std::unique_ptr<DirectLight> direct_;
};

Polygon3 levelQuad(double x0, double x1, double y0, double y1, double z, bool up) {
  const Polygon3 p{V(x0, y0, z), V(x1, y0, z), V(x1, y1, z), V(x0, y1, z)};
  return up ? p : Polygon3(p.rbegin(), p.rend());
}

/// E[i] at (x[i], 0, 0) under a panel of exitance `radiosity`.
Evaluate underPanel(const Parameters& g, const VerifyContext& context, const Polygon3& panel, const Polygon3& blocker) {
  const std::vector<double> x = g["x"].numbers();
  const double radiosity = g.number("radiosity");
  const V n = g.has("element_n") ? glm::normalize(g["element_n"].vec3()) : V(0, 0, 1);
  const auto lamp = std::make_shared<ShadowedLamp>(panel, blocker);
  return [=, seed = context.seed](const Wanted& w) -> std::optional<Got> {
    const auto i = indexOf(w.name, "E", x.size());
    if (!i) return std::nullopt;
    Got got = lamp->at({V(x[*i], 0, 0), n}, w.standardError / radiosity, seed, std::uint32_t(*i));
    got.value *= radiosity;
    got.standardError *= radiosity;
    got.rounding *= radiosity;
    return got;
  };
}

Evaluate penumbra(const Parameters& g, const VerifyContext& context) {
  const double half = g.number("panel_half_side"), height = g.number("panel_height");
  const double z = g["blocker"].number("z"), from = g["blocker"].number("x_min");
  // Endless in +x and y: as far as any way from a place to the panel goes.
  double reach = half + 1.0;
  for (const double x : g["x"].numbers()) reach = std::max(reach, std::abs(x) + 1.0);
  return underPanel(g, context, levelQuad(-half, half, -half, half, height, false),
                    levelQuad(from, std::max(reach, from + 1.0), -reach, reach, z, true));
}

Evaluate panelBlocker(const Parameters& g, const VerifyContext& context) {
  const double half = g.number("panel_half_side"), blocker = g.number("blocker_half_side");
  return underPanel(g, context, levelQuad(-half, half, -half, half, g.number("panel_height"), false),
                    levelQuad(-blocker, blocker, -blocker, blocker, g.number("blocker_height"), true));
}

Evaluate plateScreen(const Parameters& g, const VerifyContext& context) {
  const Polygon3 plate = g["plate"].polygon();
  const Element e = elementOf(g);
  const Parameters screen = g["screen"];
  const std::string plane = screen["plane"].text();
  const std::vector<double> z = screen["z"].numbers();
  if (!plane.starts_with("x=") || z.size() != 2) throw LeftOut{"screens stand in a plane x=..."};
  const nlohmann::json at = plane.substr(2);
  const double x = Parameters(at, "", screen["plane"].text()).number();
  // Endless in y: as far as any way from the element to the plate goes.
  double low = e.position.y, high = e.position.y;
  for (const V& c : plate) {
    low = std::min(low, c.y);
    high = std::max(high, c.y);
  }
  const double y0 = low - 1.0, y1 = high + 1.0;
  const auto lamp = std::make_shared<ShadowedLamp>(plate, Polygon3{V(x, y0, z[0]), V(x, y1, z[0]), V(x, y1, z[1]), V(x, y0, z[1])});
  return [=, seed = context.seed](const Wanted& w) -> std::optional<Got> {
    if (w.name != "E/(rho E_plate)") return std::nullopt;
    return lamp->at(e, w.standardError, seed, 0);
  };
}

}  // namespace

std::vector<CaseKind> lightKinds() {
  return {{"attenuation", distanceAttenuation},
          {"attenuation/guard", distanceAttenuation},
          {"irradiance/point", point},
          {"irradiance/point_attenuated", pointAttenuated},
          {"irradiance/point_texel_mean", pointTexelMean},
          {"irradiance/spot", spot},
          {"irradiance/directional", directional},
          {"irradiance/sun_edge", sunEdge},
          {"irradiance/sphere", sphere},
          {"irradiance/disc", disc},
          {"irradiance/polygon", polygonEmitter},
          {"irradiance/penumbra_half_plane", penumbra},
          {"irradiance/panel_blocker", panelBlocker},
          {"cie/area_source", areaSource},
          {"cie/diffuse_plate", diffusePlate},
          {"cie/plate_screen", plateScreen}};
}

}  // namespace lmc
