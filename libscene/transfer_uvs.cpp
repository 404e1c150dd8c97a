#include "libscene/transfer_uvs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "libscene/charts.h"
#include "libscene/tracer.h"
#include "libscene/unwrap.h"

namespace lmc {

namespace {

constexpr double kMissing = 1e-3;    // of an object's area that may be found nowhere
constexpr double kSameFacing = 0.7;  // cosine between two surfaces that are one
constexpr int kMostLayers = 8;       // surfaces on each other that are looked at
constexpr double kInside = 0.98;     // how far towards its corners a triangle is looked at

/// The level that the maps were made for, to be asked what lies at a place.
class Known {
 public:
  Known(const Scene& from, double tolerance_m) : scene_(solid(from)), tracer_(scene_), tolerance_m_(tolerance_m) {
    charts_ = connectedByUv(scene_, std::vector<bool>(scene_.objects.size(), false)).chartOf;
  }

  struct Found {
    std::uint32_t triangle;
    glm::dvec2 bary;
  };

  /// The triangle at a place of the level's own coordinates that faces along the normal; of the named object before others.
  std::optional<Found> at(glm::dvec3 place_m, glm::dvec3 normal, const std::string& name) const {
    const glm::dvec3 p = place_m - scene_.centre_m;
    const double reach = tolerance_m_ + 4.0 * double(tracer_.lift_m());
    std::optional<Found> best;
    double begin = reach;  // above the place, along the normal
    for (int layer = 0; layer < kMostLayers && begin > -reach; ++layer) {
      const Hit hit = tracer_.closest({glm::vec3(p + begin * normal), glm::vec3(-normal), float(begin + reach)}, Purpose::Visibility);
      if (!hit) break;
      begin -= double(hit.t) + double(tracer_.lift_m());
      const auto c = scene_.corners_m(hit.triangle);
      const glm::dvec3 n = glm::cross(c[1] - c[0], c[2] - c[0]);
      const Object& o = scene_.objectOf(hit.triangle);
      if (!o.receive || !o.inMap || glm::dot(n, normal) < kSameFacing * glm::length(n)) continue;
      const Found found{hit.triangle, glm::dvec2(hit.bary)};
      if (o.name == name) return found;
      if (!best) best = found;
    }
    return best;
  }

  /// Map UV of a place of the level's own coordinates by the triangle's plane, beyond its borders too.
  glm::dvec2 uv(std::uint32_t triangle, glm::dvec3 place_m) const {
    const auto c = scene_.corners_m(triangle);
    const glm::dvec3 e1 = c[1] - c[0], e2 = c[2] - c[0], n = glm::cross(e1, e2), d = place_m - scene_.centre_m - c[0];
    const double area2 = glm::dot(n, n), s = glm::dot(glm::cross(d, e2), n) / area2, t = glm::dot(glm::cross(e1, d), n) / area2;
    const glm::uvec3 v = scene_.triangles[triangle];
    return (1.0 - s - t) * glm::dvec2(scene_.mapUv[v.x]) + s * glm::dvec2(scene_.mapUv[v.y]) + t * glm::dvec2(scene_.mapUv[v.z]);
  }
  std::uint32_t chart(std::uint32_t triangle) const { return charts_[triangle]; }
  std::uint32_t map(std::uint32_t triangle) const { return scene_.objectOf(triangle).map; }

 private:
  /// All surfaces stop rays, those without a shadow too.
  static Scene solid(Scene scene) {
    for (Object& o : scene.objects) o.cast = true;
    for (Material& m : scene.materials) {
      m.alpha = Material::Alpha::Opaque;
      m.transmissive = false;
    }
    return scene;
  }

  Scene scene_;
  Tracer tracer_;
  double tolerance_m_;
  std::vector<std::uint32_t> charts_;
};

struct Transferred {
  CornerUvs uvs;
  std::uint32_t map = kNone;
  std::string problem;
};

Transferred transferred(const Known& known, const Scene& to, const Object& o, int side) {
  Transferred out;
  double area_m2 = 0.0, missing_m2 = 0.0, broken_m2 = 0.0;
  for (std::uint32_t t = o.firstTriangle; t < o.firstTriangle + o.triangleCount; ++t) {
    auto c = to.corners_m(t);
    for (glm::dvec3& p : c) p += to.centre_m;
    const glm::dvec3 n = glm::cross(c[1] - c[0], c[2] - c[0]), middle = (c[0] + c[1] + c[2]) / 3.0;
    const double area = 0.5 * glm::length(n);
    area_m2 += area;
    std::array<glm::vec2, 3>& uv = out.uvs.emplace_back();
    const auto centre = area > 0.0 ? known.at(middle, n / (2.0 * area), o.name) : std::nullopt;
    if (!centre) {
      missing_m2 += area;
      continue;
    }
    const std::uint32_t map = known.map(centre->triangle);
    if (out.map == kNone) out.map = map;
    if (map != out.map) {
      out.problem = "its surfaces lie in more than one map";
      return out;
    }
    bool whole = true;
    for (std::size_t k = 0; k < 3; ++k) {
      const glm::dvec3 inside = middle + kInside * (c[k] - middle);
      const auto corner = known.at(inside, n / (2.0 * area), o.name);
      whole = whole && corner && known.chart(corner->triangle) == known.chart(centre->triangle);
      if (!whole) break;
      uv[k] = glm::vec2(glm::clamp(known.uv(corner->triangle, c[k]), 0.0, 1.0));
    }
    if (whole) {  // straight between the corners: the middle is the corners' mean
      const glm::dvec2 mean = (glm::dvec2(uv[0]) + glm::dvec2(uv[1]) + glm::dvec2(uv[2])) / 3.0;
      whole = glm::length(mean - known.uv(centre->triangle, middle)) * side <= 0.5;
    }
    if (!whole) broken_m2 += area;
  }
  if (missing_m2 > kMissing * area_m2)
    out.problem = fmt::format("{:.3g} % of its area are not in the baked level", 100.0 * missing_m2 / area_m2);
  else if (broken_m2 > kMissing * area_m2)
    out.problem = fmt::format("triangles of {:.3g} % of its area span borders of charts", 100.0 * broken_m2 / area_m2);
  return out;
}

}  // namespace

TransferReport transferUvs(const Scene& from, int side, Scene& to, double tolerance) {
  const Known known(from, tolerance * double(from.extent_m));
  TransferReport out;
  std::vector<CornerUvs> uvs(to.objects.size());
  for (std::uint32_t i = 0; i < to.objects.size(); ++i) {
    Object& o = to.objects[i];
    if (!o.receive || o.triangleCount == 0) continue;
    Transferred t = transferred(known, to, o, side);
    if (t.problem.empty() && t.map == kNone) t.problem = "none of its surfaces is in the baked level";
    if (!t.problem.empty()) {
      out.unmatched.emplace_back(i, t.problem);
      o.receive = false;  // has no place in the map
      continue;
    }
    uvs[i] = std::move(t.uvs);
    o.map = t.map;
    o.texCoord = o.freeTexCoord;
    out.matched.push_back(i);
  }
  setMapUvs(to, uvs);
  return out;
}

}  // namespace lmc
