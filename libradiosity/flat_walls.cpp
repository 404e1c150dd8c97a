#include "libradiosity/flat_walls.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

#include "libscene/tracer.h"

namespace lmc {

namespace {

constexpr double kLeastWall = 1e-4;               // of the level's opaque area
constexpr double kLeastCosine = 0.99;             // of a triangle with the wall: slivers know their normals badly
constexpr std::uint64_t kMostTests = 20'000'000;  // of a triangle with a wall: about 0.1 s
constexpr std::size_t kMostSeeds = 256;
constexpr std::size_t kMostParts = 4096;

struct Face {
  std::uint32_t triangle;
  glm::dvec3 normal;
  double area;
};

void setPlane(FlatWall& w, const glm::dvec3& normal, const glm::dvec3& through) {
  w.normal = normal;
  w.offset_m = glm::dot(normal, through);
  const glm::dvec3 off = std::abs(normal.x) < 0.5 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  w.u = glm::normalize(glm::cross(off, normal));
  w.v = glm::cross(normal, w.u);
}

/// Least squares h = a + b u + c v over the corners, weighted by area: one triangle alone would tilt the plane of a wall that is much
/// larger by its own rounding.
void fitPlane(FlatWall& w, const Scene& scene, const std::vector<Face>& faces, const std::vector<std::uint32_t>& members) {
  double area = 0.0;
  glm::dvec3 centre(0.0);
  for (const std::uint32_t m : members)
    for (const glm::dvec3& c : scene.corners_m(faces[m].triangle)) centre += faces[m].area / 3.0 * c, area += faces[m].area / 3.0;
  centre /= area;
  double uu = 0.0, uv = 0.0, vv = 0.0, uh = 0.0, vh = 0.0;
  for (const std::uint32_t m : members)
    for (const glm::dvec3& c : scene.corners_m(faces[m].triangle)) {
      const glm::dvec3 x = c - centre;
      const double a = faces[m].area, p = glm::dot(w.u, x), q = glm::dot(w.v, x), h = glm::dot(w.normal, x);
      uu += a * p * p, uv += a * p * q, vv += a * q * q, uh += a * p * h, vh += a * q * h;
    }
  const double det = uu * vv - uv * uv;
  if (!(det > 1e-12 * (uu + vv) * (uu + vv))) return;
  const double b = (uh * vv - vh * uv) / det, c = (vh * uu - uh * uv) / det;
  setPlane(w, glm::normalize(w.normal - b * w.u - c * w.v), centre);
}

/// Triangles and outlines in the plane's own coordinates. An edge that two triangles of one side share, run through both ways, bounds
/// nothing.
void fill(FlatWall& w, const Scene& scene, const std::vector<Face>& faces, const std::vector<std::uint32_t>& members) {
  using Corner = std::array<float, 3>;
  struct Edge {
    bool up;  // the side that its triangle faces
    Corner a, b;
    int turns;  // +1 from a to b, -1 the other way
    auto key() const { return std::tie(up, a, b); }
  };
  std::vector<Edge> edges;
  for (const std::uint32_t m : members) {
    const Face& f = faces[m];
    const bool up = glm::dot(f.normal, w.normal) > 0.0;
    const glm::uvec3 t = scene.triangles[f.triangle];
    std::array<glm::dvec2, 3> flat;
    for (int k = 0; k < 3; ++k) flat[std::size_t(k)] = w.flat(glm::dvec3(scene.positions_m[t[k]]));
    if (!up) std::swap(flat[1], flat[2]);
    w.triangles.push_back(flat);
    w.area_m2 += f.area;
    for (int k = 0; k < 3; ++k) {
      const glm::vec3 &p = scene.positions_m[t[k]], &q = scene.positions_m[t[(k + 1) % 3]];
      Corner a{p.x, p.y, p.z}, b{q.x, q.y, q.z};
      const int turns = a < b ? 1 : -1;
      if (b < a) std::swap(a, b);
      edges.push_back({up, a, b, turns});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) { return a.key() < b.key(); });
  for (std::size_t i = 0; i < edges.size();) {
    int turns = 0;
    std::size_t k = i;
    for (; k < edges.size() && edges[k].key() == edges[i].key(); ++k) turns += edges[k].turns;
    if (turns != 0) {
      const Corner &a = edges[i].a, &b = edges[i].b;
      w.outlines.emplace_back(w.flat({a[0], a[1], a[2]}), w.flat({b[0], b[1], b[2]}));
    }
    i = k;
  }
}

double cross(const glm::dvec2& a, const glm::dvec2& b) { return Polygon2::cross(a, b); }

bool covered(const FlatWall& w, const glm::dvec2& p) {
  return std::ranges::any_of(w.triangles, [&](const std::array<glm::dvec2, 3>& t) {
    return cross(t[1] - t[0], p - t[0]) >= 0.0 && cross(t[2] - t[1], p - t[1]) >= 0.0 && cross(t[0] - t[2], p - t[2]) >= 0.0;
  });
}

/// How much of a segment lies inside the polygon, deeper than `width`. [m]
double lengthInside(const Polygon2& polygon, const glm::dvec2& a, const glm::dvec2& b, double width) {
  double from = 0.0, to = 1.0;
  const auto& c = polygon.corners();
  for (std::size_t i = 0; i < c.size() && from < to; ++i) {
    const glm::dvec2 e = c[(i + 1) % c.size()] - c[i];
    const double l = glm::length(e);
    if (!(l > 0.0)) continue;
    const double da = cross(e, a - c[i]) / l - width, db = cross(e, b - c[i]) / l - width;
    if (da < 0.0 && db < 0.0) return 0.0;
    if (da < 0.0) from = std::max(from, da / (da - db));
    if (db < 0.0) to = std::min(to, da / (da - db));
  }
  return to > from ? (to - from) * glm::distance(a, b) : 0.0;
}

}  // namespace

double widthOf(const Polygon2& polygon) {
  const auto& c = polygon.corners();
  if (c.size() < 3) return 0.0;
  double least = std::numeric_limits<double>::max();
  for (std::size_t i = 0; i < c.size(); ++i) {
    const glm::dvec2 e = c[(i + 1) % c.size()] - c[i];
    const double l = glm::length(e);
    if (!(l > 0.0)) continue;
    double farthest = 0.0;
    for (const glm::dvec2& p : c) farthest = std::max(farthest, cross(e, p - c[i]) / l);
    least = std::min(least, farthest);
  }
  return least < std::numeric_limits<double>::max() ? least : 0.0;
}

std::vector<FlatWall> flatWalls(const Scene& scene, double rounding_m) {
  std::vector<Face> faces;
  double whole = 0.0;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    const Material& m = scene.materialOf(t);
    if (!scene.objectOf(t).cast || m.alpha != Material::Alpha::Opaque || m.transmissive) continue;
    const auto c = scene.corners_m(t);
    if (isDegenerate(c)) continue;
    const glm::dvec3 n = glm::cross(c[1] - c[0], c[2] - c[0]);
    faces.push_back({t, glm::normalize(n), 0.5 * glm::length(n)});
    whole += faces.back().area;
  }
  std::vector<FlatWall> walls;
  if (faces.empty()) return walls;
  std::vector<std::uint32_t> bySize(faces.size());
  std::iota(bySize.begin(), bySize.end(), 0u);
  std::stable_sort(bySize.begin(), bySize.end(), [&](std::uint32_t a, std::uint32_t b) { return faces[a].area > faces[b].area; });
  std::vector<bool> used(faces.size(), false);
  const std::size_t seeds = std::min<std::size_t>(kMostSeeds, kMostTests / (2 * faces.size()) + 1);
  std::vector<std::uint32_t> members;
  // `lean`: what the plane may be off by at a distance of 1 m from `from`.
  const auto gather = [&](const FlatWall& w, const glm::dvec3& from, double lean) {
    members.clear();
    for (std::uint32_t f = 0; f < faces.size(); ++f) {
      if (used[f] || std::abs(glm::dot(faces[f].normal, w.normal)) < kLeastCosine) continue;
      const auto c = scene.corners_m(faces[f].triangle);
      if (std::ranges::all_of(c, [&](const glm::dvec3& x) {
            return std::abs(glm::dot(w.normal, x) - w.offset_m) <= rounding_m + (lean > 0.0 ? lean * glm::distance(x, from) : 0.0);
          }))
        members.push_back(f);
    }
  };
  std::size_t tried = 0;
  for (const std::uint32_t seed : bySize) {
    if (used[seed]) continue;
    if (++tried > seeds) break;
    const auto c = scene.corners_m(faces[seed].triangle);
    const double longest = std::max({glm::distance(c[0], c[1]), glm::distance(c[1], c[2]), glm::distance(c[2], c[0])});
    FlatWall w;
    setPlane(w, faces[seed].normal, (c[0] + c[1] + c[2]) / 3.0);
    gather(w, c[0], rounding_m * longest / (2.0 * faces[seed].area));
    if (!members.empty()) fitPlane(w, scene, faces, members);
    gather(w, c[0], 0.0);
    used[seed] = true;
    for (const std::uint32_t m : members) used[m] = true;
    if (members.empty()) continue;
    fill(w, scene, faces, members);
    if (w.area_m2 >= kLeastWall * whole) walls.push_back(std::move(w));
  }
  return walls;
}

std::vector<Polygon2> openParts(const FlatWall& wall, const Polygon2& polygon, double width_m, std::uint64_t& work,
                                std::uint64_t mostWork) {
  struct Part {
    Polygon2 polygon;
    std::vector<std::uint32_t> outlines;
  };
  std::vector<Polygon2> open;
  std::vector<Part> parts(1);
  parts[0].polygon = polygon;
  parts[0].outlines.resize(wall.outlines.size());
  std::iota(parts[0].outlines.begin(), parts[0].outlines.end(), 0u);
  std::size_t made = 0;
  while (!parts.empty()) {
    Part part = std::move(parts.back());
    parts.pop_back();
    if (widthOf(part.polygon) <= width_m) continue;
    // Cut along the outline that runs farthest through it; where none does, it is covered wholly or not at all.
    double longest = 0.0;
    std::uint32_t cut = kNone;
    std::erase_if(part.outlines, [&](std::uint32_t o) {
      const double l = lengthInside(part.polygon, wall.outlines[o].first, wall.outlines[o].second, width_m);
      if (l > longest) longest = l, cut = o;
      return !(l > 0.0);
    });
    work += part.outlines.size() + part.polygon.corners().size();
    if (cut == kNone) {
      work += wall.triangles.size();
      glm::dvec2 middle(0.0);
      for (const glm::dvec2& c : part.polygon.corners()) middle += c / double(part.polygon.corners().size());
      if (!covered(wall, middle)) open.push_back(std::move(part.polygon));
      continue;
    }
    if (work > mostWork || ++made > kMostParts) return {polygon};
    const auto [a, b] = wall.outlines[cut];
    std::erase(part.outlines, cut);
    Part other = part;
    part.polygon.clip(a, b - a);
    other.polygon.clip(b, a - b);
    parts.push_back(std::move(part));
    parts.push_back(std::move(other));
  }
  return open;
}

}  // namespace lmc
