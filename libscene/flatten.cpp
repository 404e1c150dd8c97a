#include "libscene/flatten.h"

#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_parameterization/LSCM_parameterizer_3.h>
#include <CGAL/Surface_mesh_parameterization/parameterize.h>
#include <CGAL/box_intersection_d.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "libscene/constants.h"
#include "libscene/disjoint_sets.h"

namespace lmc {

namespace {

constexpr double kFlat = 1e-4;                // the face normals of a flat chart differ by less [rad]: its stretch is below 1e-8
constexpr double kMostCurvature = 1.1 * kPi;  // integral of Gauss' curvature of one chart: a quarter of a sphere, and rounding
constexpr std::size_t kMostFaces = 100000;    // of a conformal chart: its system is solved directly
constexpr double kNoArea = 1e-9;              // of the chart's: faces below it may lose their place to rounding
constexpr double kGrid = 0x1p28;              // places in the plane are compared as whole numbers

/// A chart with vertices of its own: one for each fan of faces, so that it is a manifold whatever the surface is.
struct Patchwork {
  std::vector<glm::dvec3> vertices_m;
  std::vector<glm::uvec3> corners;
  std::vector<bool> border;  // of the vertices
  bool closed = true;        // without a border
};

Patchwork patchwork(const Surface& s, std::span<const std::uint32_t> faces, const FaceSets& sets) {
  const std::uint32_t set = sets.set[faces[0]];
  // Corners of neighbours at the ends of their common edge are one vertex.
  DisjointSets joined(3 * faces.size());
  Patchwork out;
  std::vector<bool> borderCorner(joined.size(), false);
  for (std::uint32_t i = 0; i < faces.size(); ++i)
    for (std::uint32_t k = 0; k < 3; ++k) {
      const std::uint32_t other = s.neighbours[faces[i]][k];
      if (other == kNone || sets.set[other] != set) {
        borderCorner[3 * i + k] = borderCorner[3 * i + (k + 1) % 3] = true;
        out.closed = false;
        continue;
      }
      const std::uint32_t j = sets.number[other];
      for (std::uint32_t m = 0; m < 3; ++m)
        if (s.neighbours[other][m] == faces[i] && s.triangles[other][int(m)] == s.triangles[faces[i]][int((k + 1) % 3)]) {
          joined.join(3 * i + k, 3 * j + (m + 1) % 3);
          joined.join(3 * i + (k + 1) % 3, 3 * j + m);
        }
    }
  std::vector<std::uint32_t> number(joined.size(), kNone);
  for (std::uint32_t i = 0; i < faces.size(); ++i) {
    glm::uvec3 t;
    for (std::uint32_t k = 0; k < 3; ++k) {
      const std::uint32_t r = joined.root(3 * i + k);
      if (number[r] == kNone) {
        number[r] = std::uint32_t(out.vertices_m.size());
        out.vertices_m.push_back(s.positions_m[s.triangles[faces[i]][int(k)]]);
        out.border.push_back(false);
      }
      t[int(k)] = number[r];
      if (borderCorner[3 * i + k]) out.border[number[r]] = true;
    }
    out.corners.push_back(t);
  }
  return out;
}

/// Sum of the angle defects at inner vertices: the integral of Gauss' curvature.
double curvature(const Patchwork& p) {
  std::vector<double> angle(p.vertices_m.size(), 0.0);
  for (const glm::uvec3& t : p.corners)
    for (int k = 0; k < 3; ++k) {
      const glm::dvec3 a = p.vertices_m[t[k]], b = p.vertices_m[t[(k + 1) % 3]] - a, c = p.vertices_m[t[(k + 2) % 3]] - a;
      angle[t[k]] += std::atan2(glm::length(glm::cross(b, c)), glm::dot(b, c));
    }
  double sum = 0.0;
  for (std::size_t v = 0; v < angle.size(); ++v)
    if (!p.border[v]) sum += 2.0 * kPi - angle[v];
  return sum;
}

std::vector<glm::dvec2> project(const Patchwork& p, glm::dvec3 normal) {
  const glm::dvec3 helper = std::abs(normal.y) < 0.9 ? glm::dvec3(0, 1, 0) : glm::dvec3(1, 0, 0);
  const glm::dvec3 x = glm::normalize(glm::cross(helper, normal)), y = glm::cross(normal, x);
  std::vector<glm::dvec2> uv;
  uv.reserve(p.vertices_m.size());
  for (const glm::dvec3& v : p.vertices_m) uv.emplace_back(glm::dot(v - p.vertices_m[0], x), glm::dot(v - p.vertices_m[0], y));
  return uv;
}

/// Least-squares conformal map [levy2002]; empty where it cannot be made.
std::vector<glm::dvec2> conformal(const Patchwork& p) {
  namespace Smp = CGAL::Surface_mesh_parameterization;
  using Kernel = CGAL::Simple_cartesian<double>;
  using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
  // About the first vertex, in units of the chart's size: the system's numbers are near 1 wherever the level lies.
  double size = 0.0;
  for (const glm::dvec3& v : p.vertices_m) size = std::max(size, glm::length(v - p.vertices_m[0]));
  Mesh mesh;
  mesh.reserve(p.vertices_m.size(), 3 * p.corners.size() / 2, p.corners.size());
  for (const glm::dvec3& v : p.vertices_m) {
    const glm::dvec3 q = (v - p.vertices_m[0]) / size;
    mesh.add_vertex({q.x, q.y, q.z});
  }
  for (const glm::uvec3& t : p.corners)
    if (mesh.add_face(Mesh::Vertex_index(t.x), Mesh::Vertex_index(t.y), Mesh::Vertex_index(t.z)) == Mesh::null_face()) return {};
  // From the longest border.
  Mesh::Halfedge_index longest = Mesh::null_halfedge();
  double most = -1.0;
  std::vector<bool> seen(mesh.number_of_halfedges(), false);
  for (const Mesh::Halfedge_index h : mesh.halfedges()) {
    if (!mesh.is_border(h) || seen[h]) continue;
    double length = 0.0;
    for (const Mesh::Halfedge_index b : CGAL::halfedges_around_face(h, mesh)) {
      seen[b] = true;
      length += std::sqrt(CGAL::squared_distance(mesh.point(mesh.source(b)), mesh.point(mesh.target(b))));
    }
    if (length > most) {
      most = length;
      longest = h;
    }
  }
  if (longest == Mesh::null_halfedge()) return {};
  const auto uvMap = mesh.add_property_map<Mesh::Vertex_index, Kernel::Point_2>("v:uv").first;
  if (Smp::parameterize(mesh, Smp::LSCM_parameterizer_3<Mesh>(), longest, uvMap) != Smp::OK) return {};
  std::vector<glm::dvec2> uv;
  for (const Mesh::Vertex_index v : mesh.vertices()) {
    uv.emplace_back(uvMap[v].x(), uvMap[v].y());
    if (!std::isfinite(uv.back().x) || !std::isfinite(uv.back().y)) return {};
  }
  return uv;
}

std::int64_t cross(glm::i64vec2 a, glm::i64vec2 b) { return a.x * b.y - a.y * b.x; }

}  // namespace

double stretchL2(std::span<const glm::dvec3> positions, std::span<const glm::uvec3> triangles, std::span<const glm::dvec2> uv,
                 std::span<const glm::uvec3> corners) {
  double sum = 0.0, area = 0.0, flat = 0.0, lost = 0.0;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const glm::dvec3 p0 = positions[triangles[i].x], p1 = positions[triangles[i].y], p2 = positions[triangles[i].z];
    const glm::dvec2 q0 = uv[corners[i].x], q1 = uv[corners[i].y], q2 = uv[corners[i].z];
    const double a = 0.5 * glm::length(glm::cross(p1 - p0, p2 - p0));
    const double twice = (q1.x - q0.x) * (q2.y - q0.y) - (q2.x - q0.x) * (q1.y - q0.y);
    area += a;
    flat += 0.5 * std::abs(twice);
    if (twice == 0.0) {
      lost += a;
      continue;
    }
    // About p0, so that where the level lies does not matter.
    const glm::dvec3 ss = ((p1 - p0) * (q2.y - q0.y) + (p2 - p0) * (q0.y - q1.y)) / twice;
    const glm::dvec3 st = ((p1 - p0) * (q0.x - q2.x) + (p2 - p0) * (q1.x - q0.x)) / twice;
    sum += a * 0.5 * (glm::dot(ss, ss) + glm::dot(st, st));
  }
  if (lost > kNoArea * area) return std::numeric_limits<double>::infinity();
  return area > 0.0 ? std::sqrt(sum / area * flat / area) : 1.0;
}

std::vector<std::uint32_t> overlapping(std::span<const glm::i64vec2> uv, std::span<const glm::uvec3> corners, bool first) {
  using Box = CGAL::Box_intersection_d::Box_with_info_d<double, 2, std::uint32_t>;
  std::vector<Box> boxes;
  boxes.reserve(corners.size());
  for (std::uint32_t i = 0; i < corners.size(); ++i) {
    if (twiceArea(uv, corners[i]) == 0) continue;
    const glm::i64vec2 a = uv[corners[i].x], b = uv[corners[i].y], c = uv[corners[i].z];
    const glm::dvec2 lo(glm::min(a, glm::min(b, c))), hi(glm::max(a, glm::max(b, c)));
    boxes.emplace_back(CGAL::Bbox_2(lo.x, lo.y, hi.x, hi.y), i);
  }
  // An edge separates when all of the other triangle lies on its right or on it.
  const auto separates = [&](glm::uvec3 t, glm::uvec3 other) {
    for (int k = 0; k < 3; ++k) {
      const glm::i64vec2 p = uv[t[k]], d = uv[t[(k + 1) % 3]] - p;
      if (cross(d, uv[other.x] - p) <= 0 && cross(d, uv[other.y] - p) <= 0 && cross(d, uv[other.z] - p) <= 0) return true;
    }
    return false;
  };
  std::vector<std::uint32_t> out;
  struct Found {};
  try {
    CGAL::box_self_intersection_d(boxes.begin(), boxes.end(), [&](const Box& a, const Box& b) {
      const glm::uvec3 s = corners[a.info()], t = corners[b.info()];
      if (separates(s, t) || separates(t, s)) return;
      out.push_back(std::max(a.info(), b.info()));
      if (first) throw Found();
    });
  } catch (const Found&) {
  }
  std::ranges::sort(out);
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

bool acceptChart(FlatChart& chart, const Surface& s, double maxStretch) {
  double area_m2 = 0.0, flat = 0.0;
  for (const std::uint32_t f : chart.faces) area_m2 += s.areas_m2[f];
  glm::dvec2 lo(std::numeric_limits<double>::infinity()), hi(-lo);
  for (const glm::uvec3& t : chart.corners) {
    const glm::dvec2 a = chart.uv_m[t.x], b = chart.uv_m[t.y] - a, c = chart.uv_m[t.z] - a;
    flat += 0.5 * (b.x * c.y - b.y * c.x);
  }
  if (!(flat > 0.0)) return false;
  const double scale = std::sqrt(area_m2 / flat);
  for (glm::dvec2& v : chart.uv_m) {
    v *= scale;
    lo = glm::min(lo, v);
    hi = glm::max(hi, v);
  }
  for (glm::dvec2& v : chart.uv_m) v -= lo;
  const double size = std::max(hi.x - lo.x, hi.y - lo.y);
  std::vector<glm::i64vec2> grid;
  grid.reserve(chart.uv_m.size());
  for (const glm::dvec2& v : chart.uv_m) grid.emplace_back(glm::i64vec2(glm::round(v * (kGrid / size))));
  std::vector<glm::uvec3> triangles;
  triangles.reserve(chart.faces.size());
  for (std::size_t i = 0; i < chart.faces.size(); ++i) {
    const glm::uvec3 t = chart.corners[i];
    const std::int64_t area = twiceArea(grid, t);
    if (area < 0 || (area == 0 && s.areas_m2[chart.faces[i]] > kNoArea * area_m2)) return false;
    triangles.push_back(s.triangles[chart.faces[i]]);
  }
  chart.stretch = stretchL2(s.positions_m, triangles, chart.uv_m, chart.corners);
  return chart.stretch <= maxStretch && overlapping(grid, chart.corners, true).empty();
}

FlatChart flattenFace(const Surface& s, std::uint32_t face) {
  const glm::uvec3 t = s.triangles[face];
  const glm::dvec3 a = s.positions_m[t.x], b = s.positions_m[t.y] - a, c = s.positions_m[t.z] - a;
  const double length = glm::length(b);
  FlatChart out;
  out.faces = {face};
  out.corners = {{0, 1, 2}};
  const double x = glm::dot(b, c) / length, left = std::min(0.0, x);
  out.uv_m = {{-left, 0.0}, {length - left, 0.0}, {x - left, 2.0 * s.areas_m2[face] / length}};
  return out;
}

std::optional<FlatChart> flatten(const Surface& s, std::span<const std::uint32_t> faces, const FaceSets& sets, double maxStretch) {
  if (faces.size() == 1) return flattenFace(s, faces[0]);
  glm::dvec3 normal(0.0);
  for (const std::uint32_t f : faces) normal += s.areas_m2[f] * s.normals[f];
  const double length = glm::length(normal);
  bool flat = length > 0.0;
  if (flat) normal /= length;
  for (std::size_t i = 0; flat && i < faces.size(); ++i) flat = glm::length(s.normals[faces[i]] - normal) < kFlat;
  if (!flat && faces.size() > kMostFaces) return std::nullopt;
  const Patchwork p = patchwork(s, faces, sets);
  if (p.closed || (!flat && std::abs(curvature(p)) > kMostCurvature)) return std::nullopt;
  FlatChart chart;
  chart.faces.assign(faces.begin(), faces.end());
  chart.corners = p.corners;
  chart.uv_m = flat ? project(p, normal) : conformal(p);
  if (chart.uv_m.empty() || !acceptChart(chart, s, maxStretch)) return std::nullopt;
  return chart;
}

}  // namespace lmc
