#include "libradiosity/patch_mesh.h"

#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <deque>
#include <queue>
#include <unordered_map>

#include "libscene/rng.h"
#include "libscene/texel_array.h"
#include "libscene/texture.h"
#include "libscene/tracer.h"

namespace lmc {

namespace {

struct Traits : OpenMesh::DefaultTraits {
  using Point = OpenMesh::Vec3d;
  using Normal = OpenMesh::Vec3d;
  FaceAttributes(0);
  VertexAttributes(0);
  HalfedgeAttributes(OpenMesh::Attributes::PrevHalfedge);
  EdgeAttributes(0);
  FaceTraits {
    std::uint32_t node = kNone;                    // in PatchMesh::nodes
    std::uint32_t triangle = kNone;                // of the scene
    std::array<OpenMesh::VertexHandle, 3> corner;  // in the node's order
    std::array<glm::vec2, 3> bary;                 // in the triangle's weights
    std::uint8_t level = 0;                        // how often the size of patches is halved here
    std::uint32_t group = kNone;                   // that was found good at this level
  };
};
using Mesh = OpenMesh::TriMesh_ArrayKernelT<Traits>;

constexpr float kReflectanceSpread = 0.05f;  // of one group; steps of this size over a few patches leave the bounced light as it is
constexpr double kSamePlace = 0x1p-21;       // of the level's extent, 4 ulp: one corner written by two meshes or two sides of a UV cut
constexpr int kMaskSamples = 64;             // per leaf, for its share of holes

bool reflects(const Scene& scene, std::uint32_t t) {
  const Object& object = scene.objectOf(t);
  return object.cast && scene.materials[object.material].opaqueToLight() && !isDegenerate(scene.corners_m(t));
}

struct PositionHash {
  std::size_t operator()(const glm::vec3& p) const {
    std::uint32_t b[3];
    const glm::vec3 q = p + 0.0f;  // -0 and 0 are one place
    std::memcpy(b, &q, sizeof b);
    return combine(combine(b[0], b[1]), b[2]);
  }
};

/// Triangles, welded where `place` of their corners is the same; where that is not manifold a triangle keeps corners of its own. Faces have
/// their triangle's number as their node's.
template <class Wanted, class Place>
Mesh weld(const Scene& scene, Wanted&& wanted, Place&& place, std::uint64_t& unjoined) {
  Mesh mesh;
  // Else it grows by doubling, and holds three times what it needs while it does.
  const std::size_t n = scene.triangles.size();
  mesh.reserve(scene.positions_m.size(), n + n / 2 + scene.positions_m.size() / 2, n);
  std::unordered_map<glm::vec3, OpenMesh::VertexHandle, PositionHash> at;
  const auto point = [](const glm::vec3& p) { return OpenMesh::Vec3d(p.x, p.y, p.z); };
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    if (!wanted(t)) continue;
    std::array<OpenMesh::VertexHandle, 3> v;
    for (int k = 0; k < 3; ++k) {
      const glm::vec3 p = place(scene.triangles[t][k]);
      const auto [it, fresh] = at.try_emplace(p + 0.0f);
      if (fresh) it->second = mesh.add_vertex(point(p));
      v[std::size_t(k)] = it->second;
    }
    // add_face complains on stderr about complex edges: ask before.
    bool manifold = v[0] != v[1] && v[1] != v[2] && v[2] != v[0];
    for (int k = 0; k < 3 && manifold; ++k) {
      const auto a = v[std::size_t(k)], b = v[std::size_t((k + 1) % 3)];
      const OpenMesh::HalfedgeHandle h = mesh.find_halfedge(a, b);
      manifold = mesh.is_boundary(a) && (!h.is_valid() || mesh.is_boundary(h));
    }
    OpenMesh::FaceHandle f;
    if (manifold) {
      omerr().disable();
      f = mesh.add_face(v[0], v[1], v[2]);
      omerr().enable();
    }
    if (!f.is_valid()) {
      ++unjoined;
      for (int k = 0; k < 3; ++k) v[std::size_t(k)] = mesh.add_vertex(point(scene.positions_m[scene.triangles[t][k]]));
      f = mesh.add_face(v[0], v[1], v[2]);
    }
    auto& data = mesh.data(f);
    data.node = data.triangle = t;
    data.corner = v;
    data.bary = {glm::vec2(0, 0), glm::vec2(1, 0), glm::vec2(0, 1)};
  }
  return mesh;
}

/// For each vertex the first one that is no farther than `reach_m`.
std::vector<std::uint32_t> firstNear(const Scene& scene, double reach_m) {
  // Cells of twice the reach: what is within reach lies in one of eight.
  std::unordered_multimap<std::uint64_t, std::uint32_t> cells;
  std::vector<std::uint32_t> first(scene.positions_m.size());
  const auto keyOf = [](const glm::i64vec3& c) { return combine(combine(std::uint64_t(c.x), std::uint64_t(c.y)), std::uint64_t(c.z)); };
  const double cell_m = std::max(2.0 * reach_m, 1e-300);
  for (std::uint32_t v = 0; v < first.size(); ++v) {
    const glm::dvec3 p(scene.positions_m[v]), at = p / cell_m;
    std::uint32_t best = v;
    for (int k = 0; k < 8; ++k) {
      const glm::i64vec3 corner(glm::floor(at + 0.5 * glm::dvec3(k & 1 ? 1 : -1, k & 2 ? 1 : -1, k & 4 ? 1 : -1)));
      const auto [begin, end] = cells.equal_range(keyOf(corner));
      for (auto it = begin; it != end; ++it)
        if (glm::distance(p, glm::dvec3(scene.positions_m[it->second])) <= reach_m) best = std::min(best, it->second);
    }
    first[v] = best;
    if (best == v) cells.emplace(keyOf(glm::i64vec3(glm::floor(at))), v);
  }
  return first;
}

/// Of a square patch; a hair more, so that squares of the very size are not cut.
double diameterOf_m(double size_m) { return std::sqrt(2.0) * size_m * (1.0 + 1e-9); }

double halved(double length, std::uint8_t level) { return std::ldexp(length, -int(level)); }

/// Cuts edges in the middle until none of a face is longer than `maxEdge_m`, halved as often as the face's level says; longest first, and
/// an edge only when it is the longest of both its triangles (else their longest goes first, whatever their level), so that angles do not
/// get worse than those of the input and triangles grow slowly away from small ones; both sides of an edge are cut at one place.
void subdivide(Mesh& mesh, double maxEdge_m, std::vector<PatchMesh::Node>& nodes) {
  using Entry = std::pair<double, int>;
  const auto later = [](const Entry& a, const Entry& b) { return a.first != b.first ? a.first < b.first : a.second > b.second; };
  std::priority_queue<Entry, std::vector<Entry>, decltype(later)> queue(later);
  const auto faceOf = [&](OpenMesh::EdgeHandle e, unsigned side) { return mesh.face_handle(mesh.halfedge_handle(e, side)); };
  const auto push = [&](OpenMesh::EdgeHandle e) {
    const double l = mesh.calc_edge_length(e);
    std::uint8_t level = 0;
    for (unsigned side = 0; side < 2; ++side)
      if (const auto f = faceOf(e, side); f.is_valid()) level = std::max(level, mesh.data(f).level);
    if (l > halved(maxEdge_m, level)) queue.emplace(l, e.idx());
  };
  for (const auto e : mesh.edges()) push(e);

  struct Parent {
    OpenMesh::FaceHandle face;
    std::uint32_t node, triangle;
    std::uint8_t level;
    std::uint32_t group;
    std::array<OpenMesh::VertexHandle, 3> corner;  // p, q, apex: p-q is cut, p the first in the node's order
    std::array<glm::vec2, 3> bary;
  };
  while (!queue.empty()) {
    const auto [length, index] = queue.top();
    queue.pop();
    const OpenMesh::EdgeHandle e = mesh.edge_handle(unsigned(index));
    if (mesh.calc_edge_length(e) != length) continue;  // was cut since
    Entry longest{length, index};
    for (unsigned side = 0; side < 2; ++side)
      if (const auto f = faceOf(e, side); f.is_valid())
        for (const OpenMesh::EdgeHandle other : mesh.fe_range(f))
          if (const double l = mesh.calc_edge_length(other); l > longest.first) longest = {l, other.idx()};
    if (longest.first > length) {
      queue.emplace(length, index);
      queue.push(longest);
      continue;
    }
    std::array<Parent, 2> parents;
    int count = 0;
    for (int side = 0; side < 2; ++side) {
      const OpenMesh::FaceHandle f = mesh.face_handle(mesh.halfedge_handle(e, unsigned(side)));
      if (!f.is_valid()) continue;
      const auto& data = mesh.data(f);
      const OpenMesh::VertexHandle apex = mesh.opposite_vh(mesh.halfedge_handle(e, unsigned(side)));
      const auto k = std::size_t(std::ranges::find(data.corner, apex) - data.corner.begin());
      const std::size_t p = (k + 1) % 3, q = (k + 2) % 3;
      parents[std::size_t(count++)] = {f,
                                       data.node,
                                       data.triangle,
                                       data.level,
                                       data.group,
                                       {data.corner[p], data.corner[q], apex},
                                       {data.bary[p], data.bary[q], data.bary[k]}};
      nodes[data.node].edge = std::uint8_t(p);
    }
    const OpenMesh::VertexHandle m = mesh.add_vertex(mesh.calc_edge_midpoint(e));
    mesh.split(e, m);
    for (int i = 0; i < count; ++i) {
      const Parent& parent = parents[std::size_t(i)];
      const glm::vec2 mid = 0.5f * (parent.bary[0] + parent.bary[1]);
      for (const OpenMesh::FaceHandle f : mesh.vf_range(m)) {
        bool hasApex = false, hasP = false;
        for (const OpenMesh::VertexHandle v : mesh.fv_range(f)) {
          hasApex |= v == parent.corner[2];
          hasP |= v == parent.corner[0];
        }
        if (!hasApex) continue;
        if (count == 2 && parents[0].corner[2] == parents[1].corner[2]) {
          // Two triangles back to back share all corners: tell them apart by their winding.
          bool same = false;
          for (const OpenMesh::HalfedgeHandle h : mesh.fh_range(f))
            same |= mesh.from_vertex_handle(h) == parent.corner[2] && mesh.to_vertex_handle(h) == parent.corner[0];
          for (const OpenMesh::HalfedgeHandle h : mesh.fh_range(f))
            same |= mesh.from_vertex_handle(h) == parent.corner[1] && mesh.to_vertex_handle(h) == parent.corner[2];
          if (!same) continue;
        }
        auto& data = mesh.data(f);
        const std::uint32_t child = std::uint32_t(nodes.size());
        nodes.emplace_back();
        nodes[parent.node].child[hasP ? 0 : 1] = child;
        data.node = child;
        data.triangle = parent.triangle;
        data.level = parent.level;
        data.group = parent.group;
        if (hasP) {
          data.corner = {parent.corner[0], m, parent.corner[2]};
          data.bary = {parent.bary[0], mid, parent.bary[2]};
        } else {
          data.corner = {m, parent.corner[1], parent.corner[2]};
          data.bary = {mid, parent.bary[1], parent.bary[2]};
        }
      }
    }
    for (const OpenMesh::EdgeHandle around : mesh.ve_range(m)) push(around);
  }
}

glm::dvec3 at(const Mesh& mesh, OpenMesh::VertexHandle v) {
  const auto& p = mesh.point(v);
  return {p[0], p[1], p[2]};
}

struct Box {
  glm::dvec3 lo{1e300}, hi{-1e300};
  void add(const glm::dvec3& p) {
    lo = glm::min(lo, p);
    hi = glm::max(hi, p);
  }
};

/// Numbers of the groups of adjacent faces, and what a group is like.
struct Grouping {
  std::vector<std::uint32_t> groupOf;  // one a face
  std::vector<std::uint8_t> level;     // one a group
  std::uint32_t count = 0;
};

Grouping group(const Scene& scene, const Mesh& mesh, const std::vector<Rgb>& reflectance, double size_m, double maxBend_rad) {
  Grouping g;
  g.groupOf.assign(mesh.n_faces(), kNone);
  const double minCos = std::cos(maxBend_rad);
  std::vector<glm::dvec3> normals(mesh.n_faces());
  for (const auto f : mesh.faces()) {
    const auto& c = mesh.data(f).corner;
    normals[std::size_t(f.idx())] = glm::normalize(glm::cross(at(mesh, c[1]) - at(mesh, c[0]), at(mesh, c[2]) - at(mesh, c[0])));
  }
  // A group that stays keeps its faces: made anew it could straddle what the old ones kept apart.
  std::unordered_map<std::uint32_t, std::uint32_t> kept;
  for (const auto f : mesh.faces()) {
    if (mesh.data(f).group == kNone) continue;
    const auto [it, fresh] = kept.try_emplace(mesh.data(f).group, g.count);
    if (fresh) {
      ++g.count;
      g.level.push_back(mesh.data(f).level);
    }
    g.groupOf[std::size_t(f.idx())] = it->second;
  }
  std::deque<int> front;
  for (const auto seed : mesh.faces()) {
    if (g.groupOf[std::size_t(seed.idx())] != kNone) continue;
    const std::uint32_t id = g.count++;
    const std::uint32_t object = scene.triangleObject[mesh.data(seed).triangle];
    const glm::dvec3 normal = normals[std::size_t(seed.idx())];
    const Rgb rho = reflectance[std::size_t(seed.idx())];
    const std::uint8_t level = mesh.data(seed).level;
    const double diameter_m = halved(diameterOf_m(size_m), level);
    g.level.push_back(level);
    Box box;
    for (const auto v : mesh.data(seed).corner) box.add(at(mesh, v));
    g.groupOf[std::size_t(seed.idx())] = id;
    front.assign(1, seed.idx());
    while (!front.empty()) {
      const auto f = mesh.face_handle(unsigned(front.front()));
      front.pop_front();
      for (const OpenMesh::FaceHandle n : mesh.ff_range(f)) {
        const std::size_t i = std::size_t(n.idx());
        if (g.groupOf[i] != kNone || scene.triangleObject[mesh.data(n).triangle] != object || mesh.data(n).level != level ||
            glm::dot(normals[i], normal) < minCos)
          continue;
        const Rgb d = glm::abs(reflectance[i] - rho);
        if (std::max({d.r, d.g, d.b}) > kReflectanceSpread) continue;
        Box grown = box;
        for (const auto v : mesh.data(n).corner) grown.add(at(mesh, v));
        if (glm::length(grown.hi - grown.lo) > diameter_m) continue;
        box = grown;
        g.groupOf[i] = id;
        front.push_back(n.idx());
      }
    }
  }
  return g;
}

/// Groups far smaller than a patch that nothing adjacent could take in (leaves, chain links, triangle soup): joined with others of the
/// same object, cell of space and direction.
void joinScattered(const Scene& scene, const Mesh& mesh, Grouping& g, double size_m) {
  std::vector<double> area(g.count, 0.0);
  std::vector<glm::dvec3> centre(g.count, glm::dvec3(0.0)), normal(g.count, glm::dvec3(0.0));
  std::vector<std::uint32_t> object(g.count, 0);
  for (const auto f : mesh.faces()) {
    const auto& c = mesh.data(f).corner;
    const glm::dvec3 n = 0.5 * glm::cross(at(mesh, c[1]) - at(mesh, c[0]), at(mesh, c[2]) - at(mesh, c[0]));
    const std::uint32_t id = g.groupOf[std::size_t(f.idx())];
    const double a = glm::length(n);
    area[id] += a;
    normal[id] += n;
    centre[id] += a * (at(mesh, c[0]) + at(mesh, c[1]) + at(mesh, c[2])) / 3.0;
    object[id] = scene.triangleObject[mesh.data(f).triangle];
  }
  std::unordered_map<std::uint64_t, std::uint32_t> cell;
  std::vector<std::uint32_t> to(g.count);
  std::vector<std::uint8_t> level;
  std::uint32_t count = 0;
  for (std::uint32_t id = 0; id < g.count; ++id) {
    const double own_m = halved(size_m, g.level[id]);
    if (area[id] >= 0.1 * own_m * own_m) {
      to[id] = count++;
      level.push_back(g.level[id]);
      continue;
    }
    const glm::dvec3 c = glm::floor(centre[id] / area[id] / own_m);
    const glm::dvec3 n = glm::length(normal[id]) > 0.0 ? glm::normalize(normal[id]) : glm::dvec3(0.0);
    const glm::dvec3 d = glm::floor(1.5 * n + 0.5);  // 26 directions or so
    std::uint64_t key = g.level[id] == 0 ? object[id] : combine(object[id], g.level[id]);
    for (int k = 0; k < 3; ++k) key = combine(key, combine(std::uint64_t(std::int64_t(c[k])), std::uint64_t(std::int64_t(d[k]))));
    const auto [it, fresh] = cell.try_emplace(key, count);
    if (fresh) {
      ++count;
      level.push_back(g.level[id]);
    }
    to[id] = it->second;
  }
  for (std::uint32_t& id : g.groupOf) id = to[id];
  g.count = count;
  g.level = std::move(level);
}

/// Share of a leaf that is not a hole.
double opaqueShare(const Scene& scene, const Leaf& leaf) {
  if (scene.materialOf(leaf.triangle).alpha != Material::Alpha::Mask) return 1.0;
  const Sobol4 points(combine(leaf.triangle, 7));
  int opaque = 0;
  for (int i = 0; i < kMaskSamples; ++i) {
    const glm::vec2 u = points.point2(std::uint32_t(i));
    const float s = std::sqrt(u.x);
    const glm::vec2 bary = leaf.bary[0] + s * (1.0f - u.y) * (leaf.bary[1] - leaf.bary[0]) + s * u.y * (leaf.bary[2] - leaf.bary[0]);
    opaque += alphaAt(scene, leaf.triangle, bary) >= scene.materialOf(leaf.triangle).alphaCutoff;
  }
  return double(opaque) / kMaskSamples;
}

/// Marks for halving what belongs to groups of this level over which light changes too much; whether there was any. Levels of neighbours
/// then differ by one at most.
bool refine(Mesh& mesh, const Grouping& groups, PatchMesh& out, const PatchOptions& options, std::uint8_t level) {
  for (const auto f : mesh.faces()) out.nodes[mesh.data(f).node].patch = mesh.data(f).group = groups.groupOf[std::size_t(f.idx())];
  TexelArray<std::uint32_t> groupOf(options.light.size());
  std::vector<double> area(groups.count, 0.0), sum(groups.count, 0.0), moved(groups.count, 0.0);
  double level_m2 = 0.0, level_lm = 0.0;
  for (std::size_t i = 0; i < groupOf.size(); ++i) {
    const LightAt& l = options.light[i];
    const std::uint32_t g = groupOf[i] = out.patchAt(l.triangle, l.bary, true);
    if (g == kNone) continue;
    area[g] += double(l.area_m2);
    sum[g] += double(l.area_m2) * double(l.exitance);
    level_m2 += double(l.area_m2);
    level_lm += double(l.area_m2) * double(l.exitance);
  }
  if (!(level_lm > 0.0)) return false;
  for (std::size_t i = 0; i < groupOf.size(); ++i) {
    const LightAt& l = options.light[i];
    const std::uint32_t g = groupOf[i];
    if (g != kNone) moved[g] += double(l.area_m2) * std::abs(double(l.exitance) - sum[g] / area[g]);
  }
  // Light that the mean over a patch puts at other places of it, against what a patch of the finest size sends out on average: at a coarse
  // patch a faint change counts as much as a strong one at a small patch.
  const double finest_m = halved(options.size_m, options.levels);
  const double most = options.mostMoved * level_lm / level_m2 * finest_m * finest_m;
  std::deque<OpenMesh::FaceHandle> raised;
  for (const auto f : mesh.faces()) {
    const std::uint32_t g = groups.groupOf[std::size_t(f.idx())];
    if (groups.level[g] != level || moved[g] <= most) continue;
    mesh.data(f).level = std::uint8_t(level + 1);
    raised.push_back(f);
  }
  const bool any = !raised.empty();
  while (!raised.empty()) {
    const auto f = raised.front();
    raised.pop_front();
    mesh.data(f).group = kNone;
    for (const OpenMesh::VertexHandle v : mesh.fv_range(f))
      for (const OpenMesh::FaceHandle n : mesh.vf_range(v)) {
        if (mesh.data(n).level + 1 >= mesh.data(f).level) continue;
        mesh.data(n).level = std::uint8_t(mesh.data(f).level - 1);
        raised.push_back(n);
      }
  }
  return any;
}

PatchMesh build(const Scene& scene, const PatchOptions& options, const Run& run) {
  PatchMesh out;
  out.size_m = options.size_m;
  out.nodes.assign(scene.triangles.size(), {});
  Mesh mesh = weld(
      scene, [&](std::uint32_t t) { return reflects(scene, t); }, [&](std::uint32_t v) { return scene.positions_m[v]; }, out.unjoined);
  run.progress(0.2);
  const std::uint8_t levels = options.light.empty() ? std::uint8_t(0) : options.levels;
  Grouping groups;
  std::vector<Rgb> reflectance;  // of each face's whole triangle: one picture must not make a patch of every leaf
  constexpr float kUnknown = -1.0f;
  std::vector<Rgb> ofTriangle(scene.triangles.size(), Rgb(kUnknown));
  for (std::uint8_t level = 0;; ++level) {
    subdivide(mesh, diameterOf_m(options.size_m), out.nodes);
    reflectance.resize(mesh.n_faces());
    for (const auto f : mesh.faces()) {
      const std::uint32_t t = mesh.data(f).triangle;
      if (ofTriangle[t].r == kUnknown) ofTriangle[t] = meanReflectance(scene, t);
      reflectance[std::size_t(f.idx())] = ofTriangle[t];
    }
    groups = group(scene, mesh, reflectance, options.size_m, options.maxBend_rad);
    joinScattered(scene, mesh, groups, options.size_m);
    if (level == levels || !refine(mesh, groups, out, options, level)) break;
  }
  run.progress(0.8);

  // Groups become patches in order of their numbers; a double-sided one is followed by its back.
  std::vector<std::uint32_t> first(groups.count + 1, 0);
  for (const std::uint32_t g : groups.groupOf) ++first[g + 1];
  for (std::size_t i = 1; i < first.size(); ++i) first[i] += first[i - 1];
  std::vector<std::uint32_t> next(first.begin(), first.end() - 1);
  std::vector<int> faceAt(mesh.n_faces());
  for (const auto f : mesh.faces()) faceAt[next[groups.groupOf[std::size_t(f.idx())]]++] = f.idx();
  out.leaves.reserve(mesh.n_faces());
  for (std::uint32_t g = 0; g < groups.count; ++g) {
    Patch patch;
    patch.firstLeaf = std::uint32_t(out.leaves.size());
    patch.level = groups.level[g];
    patch.size_m = float(halved(options.size_m, patch.level));
    double whole = 0.0;
    glm::dvec3 normal(0.0), rho(0.0);
    bool twoSided = false;
    const std::uint32_t id = std::uint32_t(out.patches.size());
    for (std::uint32_t i = first[g]; i < first[g + 1]; ++i) {
      const auto f = mesh.face_handle(unsigned(faceAt[i]));
      const auto& data = mesh.data(f);
      const std::array<glm::dvec3, 3> c{at(mesh, data.corner[0]), at(mesh, data.corner[1]), at(mesh, data.corner[2])};
      Leaf leaf{data.triangle, data.bary, float(lmc::area_m2(c))};
      const double a = lmc::area_m2(c), open = a * opaqueShare(scene, leaf);
      whole += a;
      patch.area_m2 += open;
      normal += glm::cross(c[1] - c[0], c[2] - c[0]);
      patch.centre_m += a * (c[0] + c[1] + c[2]) / 3.0;
      const bool cut = data.node != data.triangle;
      rho += open * glm::dvec3(cut ? meanReflectance(scene, data.triangle, data.bary) : reflectance[std::size_t(f.idx())]);
      patch.object = scene.triangleObject[data.triangle];
      twoSided = scene.materialOf(data.triangle).doubleSided;
      out.leaves.push_back(leaf);
      out.nodes[data.node].patch = id;
      out.nodes[data.node].twoSided = twoSided;
    }
    patch.leafCount = std::uint32_t(out.leaves.size()) - patch.firstLeaf;
    patch.centre_m /= whole;
    if (patch.area_m2 > 0.0) patch.reflectance = Rgb(rho / patch.area_m2);
    patch.normal = glm::length(normal) > 0.0 ? glm::normalize(normal) : glm::dvec3(0.0, 1.0, 0.0);
    for (std::uint32_t i = first[g]; i < first[g + 1]; ++i)
      for (const auto v : mesh.data(mesh.face_handle(unsigned(faceAt[i]))).corner)
        patch.radius_m = std::max(patch.radius_m, glm::distance(at(mesh, v), patch.centre_m));
    out.patches.push_back(patch);
    if (twoSided) {
      patch.normal = -patch.normal;
      patch.back = true;
      out.patches.push_back(patch);
    }
  }
  run.progress(1.0);
  return out;
}

}  // namespace

double patchSizeFor_m(const Scene& scene, double squares) {
  struct Shape {
    double area_m2, longest_m;
  };
  std::vector<Shape> shapes;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    if (!reflects(scene, t)) continue;
    const auto c = scene.corners_m(t);
    shapes.push_back({area_m2(c), std::max({glm::distance(c[0], c[1]), glm::distance(c[1], c[2]), glm::distance(c[2], c[0])})});
  }
  if (shapes.empty()) return 1.0;
  const auto count = [&](double size) {
    double n = 0.0;
    for (const Shape& s : shapes) n += std::max(s.area_m2 / (size * size), s.longest_m > 2.0 * size ? 0.5 * s.longest_m / size : 0.0);
    return n;
  };
  double lo = double(scene.extent_m) * 1e-6, hi = double(scene.extent_m) * 10.0;
  for (int step = 0; step < 50; ++step) {
    const double mid = std::sqrt(lo * hi);
    (count(mid) > squares ? lo : hi) = mid;
  }
  return hi;
}

std::vector<SharedEdge> sharedEdges(const Scene& scene, const std::function<bool(std::uint32_t)>& wanted) {
  const std::vector<std::uint32_t> first = firstNear(scene, double(scene.extent_m) * kSamePlace);
  std::uint64_t unjoined = 0;
  const Mesh mesh = weld(
      scene, wanted, [&](std::uint32_t v) { return scene.positions_m[first[v]]; }, unjoined);
  std::vector<SharedEdge> out;
  for (const auto e : mesh.edges()) {
    if (mesh.is_boundary(e)) continue;
    SharedEdge edge;
    for (unsigned side = 0; side < 2; ++side) {
      const OpenMesh::HalfedgeHandle h = mesh.halfedge_handle(e, side);
      const auto& data = mesh.data(mesh.face_handle(h));
      const auto vertexAt = [&](OpenMesh::VertexHandle end) {
        return scene.triangles[data.triangle][int(std::ranges::find(data.corner, end) - data.corner.begin())];
      };
      edge.triangle[side] = data.triangle;
      edge.vertex[side] = {vertexAt(mesh.from_vertex_handle(h)), vertexAt(mesh.to_vertex_handle(h))};
    }
    std::swap(edge.vertex[1].x, edge.vertex[1].y);  // halfedges of an edge run against each other
    out.push_back(edge);
  }
  return out;
}

PatchMesh makePatches(const Scene& scene, const PatchOptions& options, const Run& run) {
  PatchOptions grown = options;
  // A size that would cut the level's area into far more patches than allowed is not even tried.
  grown.size_m = std::max(grown.size_m, patchSizeFor_m(scene, options.maxPatches));
  for (;;) {
    PatchMesh mesh = build(scene, grown, run);
    if (mesh.patches.size() <= options.maxPatches) return mesh;
    grown.size_m *= std::max(1.25, std::sqrt(double(mesh.patches.size()) / options.maxPatches));
  }
}

namespace {

/// Down the halves of triangles to the leaf that holds a place.
struct Descent {
  const PatchMesh::Node* node = nullptr;
  std::array<float, 3> w{};  // weights of the node's corners

  Descent() = default;
  Descent(const PatchMesh::Node& triangle, glm::vec2 bary) : node(&triangle), w{1.0f - bary.x - bary.y, bary.x, bary.y} {}
  bool atLeaf() const { return node->child[0] == kNone; }
  void step(const PatchMesh::Node* nodes) {
    const float p = w[node->edge], q = w[(node->edge + 1) % 3u], apex = w[(node->edge + 2) % 3u];
    // Weights in the half that holds the place: (p, m, apex) or (m, q, apex), m the middle of p and q.
    const bool first = p >= q;
    w = first ? std::array{p - q, 2.0f * q, apex} : std::array{2.0f * p, q - p, apex};
    node = nodes + node->child[first ? 0 : 1];
  }
  std::uint32_t patch(bool front) const {
    if (node->patch == kNone || front) return node->patch;
    return node->twoSided ? node->patch + 1 : kNone;
  }
};

}  // namespace

std::uint32_t PatchMesh::patchAt(std::uint32_t triangle, glm::vec2 bary, bool front) const {
  Descent d(nodes[triangle], bary);
  while (!d.atLeaf()) d.step(nodes.data());
  return d.patch(front);
}

void PatchMesh::patchesAt(std::span<const Hit> hits, std::span<std::uint32_t> out) const {
  constexpr std::size_t kAtOnce = 64;
  std::array<Descent, kAtOnce> open;
  std::array<std::size_t, kAtOnce> hitOf;
  for (std::size_t begin = 0; begin < hits.size(); begin += kAtOnce) {
    std::size_t count = 0;
    for (std::size_t i = begin; i < std::min(begin + kAtOnce, hits.size()); ++i) {
      out[i] = kNone;
      if (!hits[i]) continue;
      open[count] = Descent(nodes[hits[i].triangle], hits[i].bary);
      hitOf[count++] = i;
    }
    // A step each in turn: every step waits for memory, and so all wait together.
    while (count > 0) {
      std::size_t left = 0;
      for (std::size_t k = 0; k < count; ++k) {
        if (open[k].atLeaf()) {
          out[hitOf[k]] = open[k].patch(hits[hitOf[k]].front);
          continue;
        }
        open[k].step(nodes.data());
        __builtin_prefetch(open[k].node);
        open[left] = open[k];
        hitOf[left++] = hitOf[k];
      }
      count = left;
    }
  }
}

std::pair<std::uint32_t, glm::dvec2> PatchMesh::sample(const Patch& patch, glm::vec2 u) const {
  double whole = 0.0;
  for (std::uint32_t i = 0; i < patch.leafCount; ++i) whole += leaves[patch.firstLeaf + i].area_m2;
  double target = double(u.x) * whole;
  const Leaf* leaf = &leaves[patch.firstLeaf];
  double rest = 0.5;
  for (std::uint32_t i = 0; i < patch.leafCount; ++i) {
    leaf = &leaves[patch.firstLeaf + i];
    rest = target / leaf->area_m2;
    if (rest < 1.0) break;
    target -= leaf->area_m2;
  }
  const double s = std::sqrt(std::clamp(rest, 0.0, 1.0));
  const glm::dvec2 a(leaf->bary[0]), b(leaf->bary[1]), c(leaf->bary[2]);
  return {leaf->triangle, a + s * (1.0 - double(u.y)) * (b - a) + s * double(u.y) * (c - a)};
}

}  // namespace lmc
