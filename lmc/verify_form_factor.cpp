/// Reference cases of form factors and of the Cornell box's geometry.
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <memory>

#include "libradiosity/direct.h"
#include "libradiosity/form_factor_bodies.h"
#include "libradiosity/occlusion.h"
#include "libscene/constants.h"
#include "libscene/scene_builder.h"
#include "lmc/verify_case.h"

namespace lmc {

namespace {

using V = glm::dvec3;

constexpr std::uint32_t kPairs = 16384;  // of each scramble: the bias of a ratio of sums goes with 1/pairs
constexpr int kLeastScrambles = 8, kMostScrambles = 512;

std::optional<Got> closed(const Wanted& w, std::string_view name, double value) {
  return w.name == name ? std::optional(Got{value}) : std::nullopt;
}

struct Element {
  V position, normal;
};

Element elementOf(const Parameters& g) {
  const Parameters e = g["element"];
  const V n = e["n"].vec3();
  if (!(glm::length(n) > 0.0)) e["n"].broken("is no direction");
  return {e["p"].vec3(), glm::normalize(n)};
}

Evaluate elementPolygon(const Parameters& g, const VerifyContext&) {
  const Element e = elementOf(g);
  const Polygon3 p = g["polygon"].polygon();
  return [=](const Wanted& w) { return closed(w, "F", elementToPolygon(e.position, e.normal, p)); };
}

Evaluate elementDisc(const Parameters& g, const VerifyContext&) {
  const Element e = elementOf(g);
  const Parameters d = g["disc"];
  const double f = elementToRoundDisc(e.position, e.normal, d["centre"].vec3(), glm::normalize(d["normal"].vec3()), d.number("radius"));
  return [=](const Wanted& w) { return closed(w, "F", f); };
}

Evaluate elementSphere(const Parameters& g, const VerifyContext&) {
  double f = 0.0;
  if (g.has("angle_deg")) {
    const double angle = g.number("angle_deg"), d = g.number("distance");
    f = elementToSphere(V(0.0), V(0, 0, 1), V(d * sinDegrees(angle), 0, d * cosDegrees(angle)), g.number("radius"));
  } else {
    const Element e = elementOf(g);
    f = elementToSphere(e.position, e.normal, g["centre"].vec3(), g.number("radius"));
  }
  return [=](const Wanted& w) { return closed(w, "F", f); };
}

Evaluate between(const Polygon3& from, const Polygon3& to) {
  return [=](const Wanted& w) -> std::optional<Got> {
    if (w.name != "F12" && w.name != "F21") return std::nullopt;
    return Got{exchangeArea_m2(from, to) / (0.5 * glm::length(polygonNormal(w.name == "F12" ? from : to)))};
  };
}

Evaluate polygonPolygon(const Parameters& g, const VerifyContext&) { return between(g["from"].polygon(), g["to"].polygon()); }

Evaluate hingedRectangles(const Parameters& g, const VerifyContext&) {
  const double a = g.number("angle_deg"), w1 = g.number("width1"), w2 = g.number("width2"), l = g.number("edge");
  const V far(w2 * cosDegrees(a), 0, w2 * sinDegrees(a)), edge(0, l, 0);
  const Polygon3 from = g.has("from") ? g["from"].polygon() : Polygon3{V(0), V(w1, 0, 0), V(w1, l, 0), edge};
  return between(from, {V(0), edge, far + edge, far});
}

Evaluate coaxial(const Parameters& g, const VerifyContext&) {
  const double r1 = g.number("r1"), r2 = g.number("r2"), d = g.number("distance");
  return [=](const Wanted& w) -> std::optional<Got> {
    if (w.name == "F12") return Got{coaxialDiscs(r1, r2, d)};
    if (w.name == "F21") return Got{coaxialDiscs(r2, r1, d)};
    return std::nullopt;
  };
}

/// Rectangle of `x` and `y` ranges at `z`, facing up or down.
Polygon3 levelRectangle(const Parameters& g, bool up) {
  const std::vector<double> x = g["x"].numbers(), y = g["y"].numbers();
  if (x.size() != 2 || y.size() != 2 || !(x[0] < x[1]) || !(y[0] < y[1])) g.broken("'x' and 'y' are no ranges");
  const double z = g.number("z");
  const Polygon3 p{V(x[0], y[0], z), V(x[1], y[0], z), V(x[1], y[1], z), V(x[0], y[1], z)};
  return up ? p : Polygon3(p.rbegin(), p.rend());
}

bool facesUp(const Parameters& g, bool otherwise) {
  if (!g.has("normal")) return otherwise;
  const std::string n = g["normal"].text();
  if (n != "+z" && n != "-z") throw LeftOut{"rectangles face +z or -z"};
  return n == "+z";
}

/// A blocker in memory, about the middle of what is looked at: floats are finest there.
struct Blocked {
  Scene scene;
  std::unique_ptr<Tracer> tracer;
};

Evaluate occludedRectangles(const Parameters& g, const VerifyContext& context) {
  const Polygon3 from = levelRectangle(g["from"], facesUp(g["from"], true)), to = levelRectangle(g["to"], facesUp(g["to"], false));
  const Polygon3 blocker = levelRectangle(g["blocker"], true);
  auto scene = std::make_shared<Blocked>();
  SceneBuilder b;
  for (const Polygon3& p : {from, to, blocker}) b.polygon(p, b.material(Rgb(0.0f)));
  scene->scene = b.scene;
  scene->tracer = std::make_unique<Tracer>(scene->scene);
  const double unoccluded = exchangeArea_m2(from, to) / (0.5 * glm::length(polygonNormal(from)));
  const PolygonSampler first(from), second(to);
  return [=, seed = context.seed](const Wanted& w) -> std::optional<Got> {
    if (w.name == "F12_unoccluded") return Got{unoccluded};
    if (w.name != "F12" && w.name != "visible_share") return std::nullopt;
    const double unit = w.name == "F12" ? unoccluded : 1.0;
    Got share = sampleUntil(w.standardError / unit, kLeastScrambles, kMostScrambles, [&](int k) {
      return visibleShare(*scene->tracer, first, second, sequence(seed, Draw::Visibility, 0, 0, 0, 0, std::uint32_t(k)), kPairs);
    });
    share.value *= unit;
    share.standardError *= unit;
    return share;
  };
}

struct Quad {
  std::string name;
  Polygon3 corners;
};

/// "F_light at NAME (x,y,z), box without blocks" -> the place.
std::optional<V> placeIn(const std::string& name) {
  const std::size_t open = name.find('('), close = name.find(')');
  if (!name.starts_with("F_light at ") || open == std::string::npos || close == std::string::npos || close < open) return std::nullopt;
  if (name.find("without blocks") == std::string::npos) return std::nullopt;
  const nlohmann::json list = nlohmann::json::parse(fmt::format("[{}]", name.substr(open + 1, close - open - 1)), nullptr, false);
  if (!list.is_array() || list.size() != 3) return std::nullopt;
  return Parameters(list, "", "").vec3();
}

double offPlane(const Polygon3& p, const V& x) {
  return std::abs(glm::dot(x - p[0], glm::normalize(glm::cross(p[1] - p[0], p[2] - p[0]))));
}

/// The box's room and lamp as a level has them; its factors through the direct light of a bake.
Evaluate cornell(const Parameters& g, const VerifyContext& context) {
  auto quads = std::make_shared<std::vector<Quad>>();
  const Parameters list = g["quads"];
  SceneBuilder b;
  const std::uint32_t wall = b.material(Rgb(0.5f)), shining = b.material(Rgb(0.5f), Rgb(1.0f));
  Polygon3 lamp, left;
  for (const auto& [name, value] : list.json().items()) {
    const Parameters quad = list[name];
    if (quad.size() > 0 && quad.at(0).size() > 0 && quad.at(0).at(0).json().is_array()) continue;  // the blocks: lists of quads
    const Polygon3 p = quad.polygon();
    b.polygon(p, name == "light" ? shining : wall);
    if (name == "light")
      lamp = p;
    else
      quads->push_back({name, p});
    if (name.starts_with("left_wall")) left = p;
  }
  if (lamp.empty()) list.broken("lacks 'light'");
  const double lampArea = 0.5 * glm::length(polygonNormal(lamp));
  auto scene = std::make_shared<Blocked>();
  scene->scene = b.scene;
  scene->tracer = std::make_unique<Tracer>(scene->scene);
  return [=, seed = context.seed](const Wanted& w) -> std::optional<Got> {
    if (w.name == "area_light") return Got{lampArea};
    if (w.name == "left_wall_4th_vertex_off_plane" && left.size() == 4) return Got{offPlane(left, left[3])};
    const std::optional<V> place = placeIn(w.name);
    if (!place || quads->empty()) return std::nullopt;
    const Quad* on = &quads->front();
    for (const Quad& q : *quads)
      if (offPlane(q.corners, *place) < offPlane(on->corners, *place)) on = &q;
    SurfacePoint p;
    p.position_m = *place;
    p.normal = p.geometricNormal = glm::normalize(polygonNormal(on->corners));
    const DirectLight direct(scene->scene, *scene->tracer, true);
    const std::vector<SurfacePoint> same(256, p);
    const double e = direct.sample(same, direct.lightsFor(p.position_m, 0.0), sequence(seed, Draw::Direct, 0, 0, 0, 0, 0)).illuminance.x;
    return Got{e / kPi, Way::Float};
  };
}

}  // namespace

std::vector<CaseKind> formFactorKinds() {
  return {{"form_factor/element_polygon", elementPolygon},         {"form_factor/element_disc", elementDisc},
          {"form_factor/element_sphere", elementSphere},           {"form_factor/polygon_polygon", polygonPolygon},
          {"form_factor/hinged_rectangles", hingedRectangles},     {"form_factor/coaxial_discs", coaxial},
          {"form_factor/occluded_rectangles", occludedRectangles}, {"data/cornell", cornell}};
}

}  // namespace lmc
