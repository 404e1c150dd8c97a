#include "libscene/charts.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <unordered_map>

#include "libscene/disjoint_sets.h"
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
constexpr std::uint64_t kMostPairs = 10'000'000, kPairsATriangle = 100;  // whose boxes meet: the same
constexpr double kNoArea = 1e-7;    // of an object's: triangles below it may have none in the map, for their UVs are rounded
constexpr double kLostArea = 1e-3;  // of an object's, without area in the map: then its UVs are no layout
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

UvFault fault(const Scene& scene, UvFault::Kind kind, std::uint32_t triangle, std::string text) {
  return {kind, scene.triangleObject[triangle], pointer(scene.objectOf(triangle)), std::move(text)};
}

using Triangles = std::vector<std::uint32_t>;

/// What a triangle takes of its map; exact, for UVs are floats.
struct UvBox {
  glm::vec2 lo, hi;
  std::uint32_t triangle;
};

/// Calls f(a, b) once for each pair of boxes that have a place in common. The boxes are parted again and again at the middle of their lower
/// ends; those on both sides go to both. A pair belongs to the part in which the lower end of what it has in common lies, so that none is
/// lost or comes twice. In place; time n log n but where most boxes lie on each other, and there most pairs are asked for.
template <class F>
void forTouching(std::span<UvBox> boxes, glm::vec2 from, glm::vec2 to, const F& f) {
  constexpr std::size_t kFew = 12;
  const auto inPairs = [&] {
    for (std::size_t i = 1; i < boxes.size(); ++i)
      for (std::size_t k = 0; k < i; ++k) {
        const UvBox &a = boxes[i], &b = boxes[k];
        const glm::vec2 lo = glm::max(a.lo, b.lo), hi = glm::min(a.hi, b.hi);
        if (lo.x > hi.x || lo.y > hi.y || lo.x < from.x || lo.y < from.y || lo.x >= to.x || lo.y >= to.y) continue;
        f(a, b);
      }
  };
  if (boxes.size() <= kFew) return inPairs();
  glm::vec2 first(boxes[0].lo), last(boxes[0].lo);
  for (const UvBox& b : boxes) {
    first = glm::min(first, b.lo);
    last = glm::max(last, b.lo);
  }
  const int longer = last.x - first.x >= last.y - first.y ? 0 : 1;
  for (const int axis : {longer, 1 - longer}) {
    const auto middle = boxes.begin() + std::ptrdiff_t(boxes.size() / 2);
    std::nth_element(boxes.begin(), middle, boxes.end(), [axis](const UvBox& a, const UvBox& b) { return a.lo[axis] < b.lo[axis]; });
    const float at = middle->lo[axis];
    const auto above = std::size_t(std::ranges::count_if(boxes, [&](const UvBox& b) { return b.hi[axis] >= at; }));
    if (4 * above > 3 * boxes.size()) continue;
    glm::vec2 end = to, begin = from;
    end[axis] = begin[axis] = at;
    const auto below = std::partition(boxes.begin(), boxes.end(), [&](const UvBox& b) { return b.lo[axis] < at; });
    forTouching(std::span(boxes.begin(), below), from, end, f);
    const auto rest = std::partition(boxes.begin(), boxes.end(), [&](const UvBox& b) { return b.hi[axis] < at; });
    return forTouching(std::span(rest, boxes.end()), begin, to, f);
  }
  inPairs();
}

/// Calls f(a, b, overlap) for pairs of triangles of one map that have inner points in common, a < b, until f returns false. Pairs that
/// `skip` names are not looked at; false when there were too many to look at all.
template <class Skip, class F>
bool forOverlaps(const Scene& scene, const Triangles& triangles, int side, Skip skip, F f) {
  struct Enough {
    bool tooMany;
  };
  std::uint64_t asked = 0;
  const std::uint64_t most = kMostPairs + kPairsATriangle * triangles.size();
  const auto onPair = [&](const UvBox& one, const UvBox& other) {
    const auto [a, b] = std::minmax(one.triangle, other.triangle);
    if (++asked > most) throw Enough{true};
    if (skip(a, b)) return;
    const auto ca = uvCorners(scene, a), cb = uvCorners(scene, b);
    if (interiorsMeet(ca, cb) && !f(a, b, overlapOf(ca, cb, side))) throw Enough{false};
  };
  std::vector<UvBox> boxes;
  boxes.reserve(triangles.size());
  for (const std::uint32_t t : triangles) {
    const glm::uvec3 v = scene.triangles[t];
    const glm::vec2 &p = scene.mapUv[v.x], &q = scene.mapUv[v.y], &r = scene.mapUv[v.z];
    boxes.push_back({glm::min(glm::min(p, q), r), glm::max(glm::max(p, q), r), t});
  }
  const auto mapOf = [&](const UvBox& b) { return scene.objectOf(b.triangle).map; };
  if (!std::ranges::is_sorted(boxes, {}, mapOf)) std::ranges::stable_sort(boxes, {}, mapOf);
  constexpr float kEndless = std::numeric_limits<float>::infinity();
  try {
    for (auto first = boxes.begin(); first != boxes.end();) {
      const auto last = std::find_if(first, boxes.end(), [&, map = mapOf(*first)](const UvBox& b) { return mapOf(b) != map; });
      forTouching(std::span(first, last), glm::vec2(-kEndless), glm::vec2(kEndless), onPair);
      first = last;
    }
  } catch (const Enough& enough) {
    return !enough.tooMany;
  }
  return true;
}

std::string overlapText(const Scene& scene, std::uint32_t a, std::uint32_t b, double area_texel2, int side) {
  return fmt::format("light-map UVs overlap: {} and {} share {:.3g} texels of a map of {} x {}", named(scene, a), named(scene, b),
                     area_texel2, side, side);
}

/// The first of the pairs of triangles that share more than rounding; too many pairs are a fault of the first triangle.
std::optional<UvFault> overlapFault(const Scene& scene, const Triangles& triangles, int side, const Run& run) {
  std::uint64_t pairs = 0, folds = 0;
  std::pair<std::uint32_t, std::uint32_t> first{kNone, kNone};
  double firstArea = 0.0;
  forOverlaps(
      scene, triangles, side, [](std::uint32_t, std::uint32_t) { return false; },
      [&](std::uint32_t a, std::uint32_t b, const Overlap& overlap) {
        if (overlap.harmless()) {
          ++folds;
          return true;
        }
        if (std::pair(a, b) < first) {
          first = {a, b};
          firstArea = overlap.area_texel2;
        }
        return ++pairs < kEnoughPairs;
      });
  if (pairs == 0) {
    if (folds > 0)
      run.note({{},
                scene.file.string(),
                "",
                fmt::format("{} pairs of light-map triangles overlap by less than 1/32 texel: taken as rounding", folds),
                "LMC_UV_FOLD"});
    return std::nullopt;
  }
  return fault(scene, UvFault::Kind::Overlap, first.first,
               overlapText(scene, first.first, first.second, firstArea, side) +
                   fmt::format("; {}{} pairs of triangles overlap", pairs == kEnoughPairs ? "at least " : "", pairs));
}

std::optional<UvFault> boundsFault(const Scene& scene, std::uint32_t t, int side) {
  const double slack = kHarmlessOutside_texel / side;
  for (const glm::dvec2 uv : uvCorners(scene, t))
    if (!(uv.x >= -slack && uv.x <= 1.0 + slack && uv.y >= -slack && uv.y <= 1.0 + slack))
      return fault(scene, UvFault::Kind::OutOfRange, t,
                   fmt::format("light-map UV ({:g}, {:g}) of {} is outside [0, 1]", uv.x, uv.y, named(scene, t)));
  return std::nullopt;
}

UvFault missing(const Scene& scene, std::uint32_t object) {
  const Object& o = scene.objects[object];
  return {UvFault::Kind::Missing, object, fmt::format("/meshes/{}/primitives/{}/attributes", o.mesh, o.primitive),
          fmt::format("object '{}' has no TEXCOORD_1", o.path)};
}

bool isPlaced(const Scene& scene, std::uint32_t t) { return orientation(uvCorners(scene, t)) != CGAL::ZERO; }

/// Triangles that share a corner in map UV space are one chart; numbered in order of their first triangles.
Charts connected(const Scene& scene, const Triangles& placed) {
  DisjointSets sets(scene.triangles.size());
  std::unordered_map<Key, std::uint32_t, KeyHash> firstAt;
  firstAt.reserve(placed.size());
  for (const std::uint32_t t : placed) {
    const glm::uvec3 v = scene.triangles[t];
    for (int k = 0; k < 3; ++k) {
      const auto [it, fresh] = firstAt.try_emplace(Key{scene.triangleObject[t], scene.mapUv[v[k]]}, t);
      if (!fresh) sets.join(t, it->second);
    }
  }
  Charts charts;
  charts.chartOf.assign(scene.triangles.size(), kNone);
  for (const std::uint32_t t : placed) {
    const std::uint32_t root = sets.root(t);
    charts.chartOf[t] = root == t ? charts.count++ : charts.chartOf[root];  // roots come first: they are the smallest of their set
  }
  return charts;
}

}  // namespace

Error uvError(const Scene& scene, const UvFault& f) {
  switch (f.kind) {
    case UvFault::Kind::Missing:
      return Error(Exit::Unsupported, scene.file, f.where, f.text + ": a light map needs UVs (--uv repair makes them)", "LMC_UV_MISSING");
    case UvFault::Kind::OutOfRange:
      return Error(Exit::Broken, scene.file, f.where, f.text, "LMC_UV_OUTSIDE");
    case UvFault::Kind::NoArea:
      return Error(Exit::Broken, scene.file, f.where, f.text, "LMC_UV_ZERO_AREA");
    default:
      return Error(Exit::Broken, scene.file, f.where, f.text, "LMC_UV_OVERLAP");
  }
}

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

std::vector<UvFault> uvFaults(const Scene& scene, int side) {
  std::vector<UvFault> out;
  std::vector<bool> faulty(scene.objects.size(), false);
  const auto add = [&](UvFault f) {
    if (faulty[f.object]) return;
    faulty[f.object] = true;
    out.push_back(std::move(f));
  };
  Triangles sound;
  for (std::uint32_t i = 0; i < scene.objects.size(); ++i) {
    const Object& o = scene.objects[i];
    if (!o.receive || o.triangleCount == 0) continue;
    if (!o.inMap) {
      add(missing(scene, i));
      continue;
    }
    Triangles placed;
    double area_m2 = 0.0, lost_m2 = 0.0;
    std::optional<UvFault> found;
    for (std::uint32_t t = o.firstTriangle; t < o.firstTriangle + o.triangleCount && !found; ++t) {
      const double a = lmc::area_m2(scene.corners_m(t));
      area_m2 += a;
      found = boundsFault(scene, t, side);
      if (isPlaced(scene, t))
        placed.push_back(t);
      else
        lost_m2 += a;
    }
    if (!found && lost_m2 > kLostArea * area_m2)
      found = fault(scene, UvFault::Kind::NoArea, o.firstTriangle,
                    fmt::format("{:.3g} % of object '{}' have no area in light-map UV space", 100.0 * lost_m2 / area_m2, o.path));
    if (!found) found = overlapFault(scene, placed, side, Run{});
    if (found)
      add(std::move(*found));
    else
      sound.insert(sound.end(), placed.begin(), placed.end());
  }
  const auto both = [&](std::uint32_t a, std::uint32_t b) {
    const std::uint32_t i = scene.triangleObject[a], j = scene.triangleObject[b];
    return i == j || (faulty[i] && faulty[j]);
  };
  const bool all = forOverlaps(scene, sound, side, both, [&](std::uint32_t a, std::uint32_t b, const Overlap& overlap) {
    if (overlap.harmless()) return true;
    const std::string text = overlapText(scene, a, b, overlap.area_texel2, side);
    add(fault(scene, UvFault::Kind::Overlap, a, text));
    add(fault(scene, UvFault::Kind::Overlap, b, text));
    return true;
  });
  if (!all)  // layouts that each fill a whole map
    for (const std::uint32_t t : sound)
      add(fault(scene, UvFault::Kind::Overlap, t, fmt::format("light-map UVs of object '{}' overlap others'", scene.objectOf(t).path)));
  std::ranges::sort(out, {}, &UvFault::object);
  return out;
}

Charts connectedByUv(const Scene& scene, const std::vector<bool>& without) {
  Triangles placed;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t)
    if (!without[scene.triangleObject[t]] && isPlaced(scene, t)) placed.push_back(t);
  return connected(scene, placed);
}

Charts findCharts(const Scene& scene, int side, const Run& run) {
  Triangles placed;
  std::uint64_t flat = 0;
  std::uint32_t firstFlat = kNone;
  for (std::uint32_t i = 0; i < scene.objects.size(); ++i) {
    const Object& o = scene.objects[i];
    if (!o.receive || o.triangleCount == 0) continue;
    if (!o.inMap) throw uvError(scene, missing(scene, i));
    double area_m2 = 0.0;
    for (std::uint32_t t = o.firstTriangle; t < o.firstTriangle + o.triangleCount; ++t) area_m2 += lmc::area_m2(scene.corners_m(t));
    for (std::uint32_t t = o.firstTriangle; t < o.firstTriangle + o.triangleCount; ++t) {
      if (const auto outside = boundsFault(scene, t, side)) throw uvError(scene, *outside);
      if (isPlaced(scene, t)) {
        placed.push_back(t);
      } else if (lmc::area_m2(scene.corners_m(t)) > kNoArea * area_m2) {
        if (flat++ == 0) firstFlat = t;
      }
    }
  }
  if (flat > 0)
    run.warn({{},
              scene.file.string(),
              pointer(scene.objectOf(firstFlat)),
              fmt::format("{} triangles have no area in light-map UV space and get no light map; the first is {}", flat,
                          named(scene, firstFlat)),
              "LMC_UV_ZERO_AREA"});
  if (const auto overlap = overlapFault(scene, placed, side, run)) throw uvError(scene, *overlap);

  return connected(scene, placed);
}

}  // namespace lmc
