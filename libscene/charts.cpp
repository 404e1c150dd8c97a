#include "libscene/charts.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/box_intersection_d.h>
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <unordered_map>

#include "libscene/polygon2.h"
#include "libscene/rng.h"
#include "libscene/tracer.h"

namespace lmc {

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_2;

constexpr double kHarmlessOutside_texel = 1.0 / 64.0;
// Charts of curved cuts fold over themselves by strips as thin as the rounding of their UVs. What two places share of a texel moves its
// mean by that share of their difference, and such places are neighbours: 1/32 of a texel stays below any goal.
constexpr double kHarmlessOverlap_texel = 1.0 / 32.0;
constexpr std::uint64_t kEnoughPairs = 1000;  // of overlapping triangles: then the layout is no layout, and counting on would take n^2
constexpr int kMinSide = 16, kMaxSide = 8192;

std::array<glm::dvec2, 3> uvCorners(const Scene& scene, std::uint32_t triangle) {
  const glm::uvec3 t = scene.triangles[triangle];
  return {glm::dvec2(scene.mapUv[t.x]), glm::dvec2(scene.mapUv[t.y]), glm::dvec2(scene.mapUv[t.z])};
}

std::string pointer(const Object& o) { return fmt::format("/meshes/{}/primitives/{}/attributes/TEXCOORD_1", o.mesh, o.primitive); }

std::string named(const Scene& scene, std::uint32_t triangle) {
  const Object& o = scene.objectOf(triangle);
  return fmt::format("triangle {} of mesh {} primitive {} (object '{}')", triangle - o.firstTriangle, o.mesh, o.primitive, o.path);
}

CGAL::Sign orientation(const std::array<glm::dvec2, 3>& t) {
  return CGAL::orientation(Point(t[0].x, t[0].y), Point(t[1].x, t[1].y), Point(t[2].x, t[2].y));
}

/// Two triangles have inner points in common unless an edge of one of them separates them; exact.
bool interiorsMeet(const std::array<glm::dvec2, 3>& a, const std::array<glm::dvec2, 3>& b) {
  const auto separates = [](const std::array<glm::dvec2, 3>& s, const std::array<glm::dvec2, 3>& other) {
    const CGAL::Sign inside = orientation(s);
    for (int e = 0; e < 3; ++e) {
      const Point p(s[e].x, s[e].y), q(s[(e + 1) % 3].x, s[(e + 1) % 3].y);
      bool apart = true;
      for (const glm::dvec2& v : other) apart = apart && CGAL::orientation(p, q, Point(v.x, v.y)) != inside;
      if (apart) return true;
    }
    return false;
  };
  return !separates(a, b) && !separates(b, a);
}

struct Overlap {
  double area_texel2 = 0.0, length_texel = 0.0;
  bool harmless() const { return area_texel2 <= kHarmlessOverlap_texel * std::max(1.0, length_texel); }
};

Overlap overlapOf(const std::array<glm::dvec2, 3>& a, const std::array<glm::dvec2, 3>& b, double side) {
  Polygon2 clipped(std::vector<glm::dvec2>(a.begin(), a.end()));
  const double sign = orientation(b) == CGAL::POSITIVE ? 1.0 : -1.0;
  for (int e = 0; e < 3; ++e) clipped.clip(b[e], sign * (b[(e + 1) % 3] - b[e]));
  Overlap out{std::abs(clipped.area()) * side * side, 0.0};
  for (const glm::dvec2& p : clipped.corners())
    for (const glm::dvec2& q : clipped.corners()) out.length_texel = std::max(out.length_texel, side * glm::distance(p, q));
  return out;
}

struct Key {
  std::uint32_t object;
  glm::vec2 uv;
  bool operator==(const Key& k) const { return object == k.object && uv == k.uv; }
};
struct KeyHash {
  std::size_t operator()(const Key& k) const {
    return combine(combine(k.object, std::bit_cast<std::uint32_t>(k.uv.x + 0.0f)), std::bit_cast<std::uint32_t>(k.uv.y + 0.0f));
  }
};

std::uint32_t rootOf(std::vector<std::uint32_t>& parent, std::uint32_t i) {
  while (parent[i] != i) i = parent[i] = parent[parent[i]];
  return i;
}

void checkBounds(const Scene& scene, const std::vector<std::uint32_t>& triangles, int side) {
  const double slack = kHarmlessOutside_texel / side;
  for (const std::uint32_t t : triangles)
    for (const glm::dvec2 uv : uvCorners(scene, t))
      if (!(uv.x >= -slack && uv.x <= 1.0 + slack && uv.y >= -slack && uv.y <= 1.0 + slack))
        throw Error(Exit::Broken, scene.file, pointer(scene.objectOf(t)),
                    fmt::format("light-map UV ({:g}, {:g}) of {} is outside [0, 1]", uv.x, uv.y, named(scene, t)), "LMC_UV_OUTSIDE");
}

void checkOverlap(const Scene& scene, const std::vector<std::uint32_t>& triangles, int side, const Run& run) {
  using Box = CGAL::Box_intersection_d::Box_with_info_d<double, 2, std::uint32_t>;
  std::vector<Box> boxes;
  boxes.reserve(triangles.size());
  for (const std::uint32_t t : triangles) {
    const auto c = uvCorners(scene, t);
    const glm::dvec2 lo = glm::min(glm::min(c[0], c[1]), c[2]), hi = glm::max(glm::max(c[0], c[1]), c[2]);
    boxes.emplace_back(CGAL::Bbox_2(lo.x, lo.y, hi.x, hi.y), t);
  }
  std::uint64_t pairs = 0, folds = 0;
  std::pair<std::uint32_t, std::uint32_t> first{kNone, kNone};
  double firstArea = 0.0;
  struct Enough {};
  const auto onPair = [&](const Box& a, const Box& b) {
    const std::pair<std::uint32_t, std::uint32_t> pair = std::minmax(a.info(), b.info());
    const auto ca = uvCorners(scene, pair.first), cb = uvCorners(scene, pair.second);
    if (!interiorsMeet(ca, cb)) return;
    const Overlap overlap = overlapOf(ca, cb, side);
    if (overlap.harmless()) {
      ++folds;
      return;
    }
    if (pair < first) {
      first = pair;
      firstArea = overlap.area_texel2;
    }
    if (++pairs == kEnoughPairs) throw Enough();
  };
  try {
    CGAL::box_self_intersection_d(boxes.begin(), boxes.end(), onPair);
  } catch (const Enough&) {
  }
  if (pairs == 0) {
    if (folds > 0)
      run.note({{},
                scene.file.string(),
                "",
                fmt::format("{} pairs of light-map triangles overlap by less than 1/32 texel: taken as rounding", folds),
                "LMC_UV_FOLD"});
    return;
  }
  throw Error(Exit::Broken, scene.file, pointer(scene.objectOf(first.first)),
              fmt::format("light-map UVs overlap: {} and {} share {:.3g} texels of a map of {} x {}; {}{} pairs of triangles overlap",
                          named(scene, first.first), named(scene, first.second), firstArea, side, side,
                          pairs == kEnoughPairs ? "at least " : "", pairs),
              "LMC_UV_OVERLAP");
}

}  // namespace

int mapSide(const Scene& scene, int wanted, double texelsPerMetre) {
  if (wanted > 0) return wanted;
  double world_m2 = 0.0, uv = 0.0;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    if (!scene.objectOf(t).receive) continue;
    const auto c = uvCorners(scene, t);
    world_m2 += area_m2(scene.corners_m(t));
    uv += 0.5 * std::abs((c[1].x - c[0].x) * (c[2].y - c[0].y) - (c[2].x - c[0].x) * (c[1].y - c[0].y));
  }
  if (!(uv > 0.0)) return kMinSide;
  const double side = std::clamp(texelsPerMetre * std::sqrt(world_m2 / uv), double(kMinSide), double(kMaxSide));
  return int(std::bit_ceil(std::uint32_t(std::ceil(side))));
}

Charts findCharts(const Scene& scene, int side, const Run& run) {
  for (const Object& o : scene.objects)
    if (o.receive && !o.inMap && o.triangleCount > 0)
      throw Error(
          Exit::Unsupported, scene.file, fmt::format("/meshes/{}/primitives/{}/attributes", o.mesh, o.primitive),
          fmt::format("object '{}' has no TEXCOORD_1: a light map needs a second UV set, and this version does not make one", o.path),
          "LMC_UV_MISSING");

  std::vector<std::uint32_t> placed;
  std::uint64_t flat = 0;
  std::uint32_t firstFlat = kNone;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    if (!scene.objectOf(t).receive) continue;
    if (orientation(uvCorners(scene, t)) != CGAL::ZERO) {
      placed.push_back(t);
    } else if (!isDegenerate(scene.corners_m(t))) {
      if (flat++ == 0) firstFlat = t;
    }
  }
  if (flat > 0)
    run.warn({{},
              scene.file.string(),
              pointer(scene.objectOf(firstFlat)),
              fmt::format("{} triangles have no area in light-map UV space and get no light map; the first is {}", flat,
                          named(scene, firstFlat)),
              "LMC_UV_ZERO_AREA"});
  checkBounds(scene, placed, side);
  checkOverlap(scene, placed, side, run);

  // Union of triangles by shared (object, UV) corners.
  std::vector<std::uint32_t> parent(scene.triangles.size());
  std::iota(parent.begin(), parent.end(), 0u);
  std::unordered_map<Key, std::uint32_t, KeyHash> firstAt;
  firstAt.reserve(placed.size());
  for (const std::uint32_t t : placed) {
    const glm::uvec3 v = scene.triangles[t];
    for (int k = 0; k < 3; ++k) {
      const auto [it, fresh] = firstAt.try_emplace(Key{scene.triangleObject[t], scene.mapUv[v[k]]}, t);
      if (!fresh) {
        const std::uint32_t a = rootOf(parent, t), b = rootOf(parent, it->second);
        parent[std::max(a, b)] = std::min(a, b);
      }
    }
  }
  Charts charts;
  charts.chartOf.assign(scene.triangles.size(), kNone);
  for (const std::uint32_t t : placed) {
    const std::uint32_t root = rootOf(parent, t);
    charts.chartOf[t] = root == t ? charts.count++ : charts.chartOf[root];  // roots come first: they are the smallest of their set
  }
  return charts;
}

}  // namespace lmc
