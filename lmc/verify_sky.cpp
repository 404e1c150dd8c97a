/// Reference cases of skies and openings.
#include <cmath>
#include <memory>

#include "libradiosity/occlusion.h"
#include "libradiosity/skies.h"
#include "libradiosity/zonal.h"
#include "libscene/constants.h"
#include "libscene/scene_builder.h"
#include "lmc/verify_case.h"

namespace lmc {

namespace {

using V = glm::dvec3;

const V kUp(0, 0, 1);
constexpr std::uint32_t kRays = 16384;  // of each scramble
constexpr int kLeastScrambles = 8, kMostScrambles = 512;

std::optional<SkyKind> skyNamed(std::string_view name) {
  if (name == "uniform") return SkyKind::Uniform;
  if (name == "Moon-Spencer") return SkyKind::MoonSpencer;
  if (name == "CIE type 1") return SkyKind::CieOvercast;
  return std::nullopt;
}

Evaluate openSky(const Parameters& g, const VerifyContext&) {
  const auto kind = skyNamed(g["sky"].text());
  if (!kind) throw LeftOut{"a sky called '" + g["sky"].text() + "' is not known"};
  const double e = g.numberOr("zenith_radiance", 1.0) * skyIlluminance(*kind, g.angle_rad("tilt"));
  return [=](const Wanted& w) { return w.name == "E" ? std::optional(Got{e}) : std::nullopt; };
}

/// Share of the open sky's illuminance that comes through an opening.
double skyComponent(SkyKind kind, const V& point, const V& normal, const Polygon3& opening) {
  if (kind == SkyKind::Uniform) {
    const Polygon3 above = clippedToFront(opening, point, kUp);
    return above.size() < 3 ? 0.0 : elementToPolygon(point, normal, above);
  }
  return skyThroughPolygon(kind, point, normal, opening, kUp) / skyIlluminance(kind, 0.0);
}

/// Seen from its front, whichever way the case lists its corners.
Polygon3 facing(Polygon3 p, const V& point) {
  if (glm::dot(point - p[0], polygonNormal(p)) < 0.0) p = Polygon3(p.rbegin(), p.rend());
  return p;
}

V normalOf(const Parameters& g) { return g.has("normal") ? glm::normalize(g["normal"].vec3()) : kUp; }

Evaluate roofOpening(const Parameters& g, const VerifyContext&) {
  const V point = g["point"].vec3(), normal = normalOf(g);
  const Polygon3 opening = facing(g["opening"].polygon(), point);
  return [=](const Wanted& w) -> std::optional<Got> {
    if (!w.name.starts_with("E/Eh ")) return std::nullopt;
    const auto kind = skyNamed(std::string_view(w.name).substr(5));
    if (!kind) return std::nullopt;
    return Got{skyComponent(*kind, point, normal, opening)};
  };
}

Evaluate facadeOpening(const Parameters& g, const VerifyContext&) {
  const V point = g["point"].vec3(), normal = normalOf(g);
  const Polygon3 window = facing(g["window"].polygon(), point);
  const double sky = skyComponent(SkyKind::Uniform, point, normal, window);
  return [=](const Wanted& w) -> std::optional<Got> {
    if (w.name == "E/Eh uniform sky, black ground") return Got{sky};
    // Ground lit by the whole sky: its exitance is albedo Eh, and the window's part below the point's height shows it.
    constexpr std::string_view kGround = "E/Eh uniform sky, endless ground of albedo ";
    if (!w.name.starts_with(kGround)) return std::nullopt;
    const nlohmann::json albedo = w.name.substr(kGround.size());
    const Polygon3 below = clippedToFront(window, point, -kUp);
    const double ground = below.size() < 3 ? 0.0 : elementToPolygon(point, normal, below);
    return Got{sky + Parameters(albedo, "", w.name).number() * ground};
  };
}

/// The mask stands beyond the window, black and as wide as any way through the window goes.
Evaluate mask(const Parameters& g, const VerifyContext& context) {
  const V point = g["point"].vec3(), normal = normalOf(g);
  const Polygon3 window = facing(g["window"].polygon(), point);
  const V inwards = glm::normalize(polygonNormal(window));
  if (std::abs(inwards.z) > 1e-12) throw LeftOut{"masks stand opposite an upright window"};
  const double elevation = g.number("mask_elevation_deg");
  if (!(elevation < 90.0)) throw LeftOut{"a mask ends below the zenith"};
  const Polygon3 sky = clippedToFront(window, point, kUp);
  const double toWindow = glm::dot(point - window[0], inwards);
  double wide = 0.0, low = 0.0;
  for (const V& c : window) {
    wide = std::max(wide, std::abs(glm::dot(c - point, glm::cross(kUp, inwards))));
    low = std::max(low, point.z - c.z);
  }
  // Twice as far from the point as the window: ways through the window are twice as wide there.
  const V middle = point - 2.0 * toWindow * inwards, side = glm::cross(kUp, inwards) * (2.5 * wide + toWindow);
  const V bottom = -(2.5 * low + toWindow) * kUp;
  const V top = 2.0 * toWindow * (sinDegrees(elevation) / cosDegrees(elevation)) * kUp;
  const double open = sky.size() < 3 ? 0.0 : elementToPolygon(point, normal, sky);
  struct Opposite {
    Scene scene;
    std::unique_ptr<Tracer> tracer;
  };
  const auto opposite = std::make_shared<Opposite>();
  SceneBuilder b;
  // About the point: floats are finest there.
  const Polygon3 quad{middle - side + bottom - point, middle + side + bottom - point, middle + side + top - point,
                      middle - side + top - point};
  b.polygon(quad, b.material(Rgb(0.0f)));
  opposite->scene = b.scene;
  opposite->tracer = std::make_unique<Tracer>(opposite->scene);
  return [=, seed = context.seed](const Wanted& w) -> std::optional<Got> {
    if (w.name != "E/Eh uniform") return std::nullopt;
    if (open == 0.0) return Got{0.0};
    Polygon3 moved = sky;
    for (V& c : moved) c -= point;
    const PolygonSampler opening(moved);
    Got got = sampleUntil(w.standardError / open, kLeastScrambles, kMostScrambles, [&](int k) {
      return visibleShareBeyond(*opposite->tracer, V(0.0), normal, opening, sequence(seed, Draw::Visibility, 0, 0, 0, 0, std::uint32_t(k)),
                                kRays);
    });
    got.value *= open;
    got.standardError *= open;
    got.rounding = 1e-6 * got.value;  // the mask's edge is stored as float
    return got;
  };
}

/// Factors of an opening in a ceiling to the five other faces of its room.
Evaluate fluxConservation(const Parameters& g, const VerifyContext&) {
  if (g["sky"].text() != "uniform") throw LeftOut{"flux through an opening is that of a uniform sky"};
  if (g.numberOr("albedo", 0.0) != 0.0) throw LeftOut{"flux conservation is for a black room"};
  const V room = g["room"].vec3();
  const Parameters o = g["opening_in_ceiling"];
  const std::vector<double> x = o["x"].numbers(), y = o["y"].numbers();
  if (x.size() != 2 || y.size() != 2) o.broken("'x' and 'y' are no ranges");
  const Polygon3 opening{V(x[0], y[1], room.z), V(x[1], y[1], room.z), V(x[1], y[0], room.z), V(x[0], y[0], room.z)};
  const auto faces = boxFaces(room.x, room.y, room.z);
  const double area = 0.5 * glm::length(polygonNormal(opening));
  const std::pair<const char*, std::size_t> names[] = {
      {"F(opening->floor)", 0}, {"F(opening->x=0)", 2}, {"F(opening->x=a)", 3}, {"F(opening->y=0)", 4}, {"F(opening->y=b)", 5}};
  std::vector<std::pair<std::string, double>> values;
  long double sum = 0.0L;
  for (const auto& [name, face] : names) {
    const long double f = exchangeAreaExtended_m2(opening, faces[face]) / area;
    values.emplace_back(name, double(f));
    sum += f;
  }
  values.emplace_back("sum", double(sum));
  return [=](const Wanted& w) -> std::optional<Got> {
    for (const auto& [name, value] : values)
      if (w.name == name) return Got{value};
    return std::nullopt;
  };
}

}  // namespace

std::vector<CaseKind> skyKinds() {
  return {{"irradiance/sky", openSky},
          {"cie/roof_opening", roofOpening},
          {"cie/facade_opening", facadeOpening},
          {"cie/mask", mask},
          {"cie/flux_conservation", fluxConservation}};
}

}  // namespace lmc
