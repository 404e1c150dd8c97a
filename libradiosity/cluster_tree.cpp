#include "libradiosity/cluster_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "libradiosity/visibility.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"
#include "libscene/texels.h"

namespace lmc {

namespace {

constexpr int kBins = 16;
// A split along a normal's component counts against one along an axis of space as if normals were places in a cube of this share of the
// node's own size (normals differ by 2 at most). With 0.5 the six walls of a room come apart before a wall is cut.
constexpr double kNormalScale = 0.5;
constexpr float kBent = 0.7f;              // cosine of a cone's half angle above which a part is taken as one bent face
constexpr std::uint32_t kThickest = 4096;  // patches of a cluster whose thickness is measured; larger ones go by their sphere
constexpr int kBalancedFrom = 48;          // depth from which nodes are halved by number, so that no tree is deeper than about 80

struct Shape {
  glm::vec3 lo{std::numeric_limits<float>::max()}, hi{-std::numeric_limits<float>::max()};
  glm::dvec3 normal{0.0};  // area-weighted
  double spread = 0.0;     // largest angle of a face of the patch with `normal` [rad]
  double area = 0.0;
  std::array<double, 6> key{};  // centre and mean normal
};

double angle(const glm::dvec3& a, const glm::dvec3& b) { return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b)); }

struct Bounds {
  std::array<double, 6> lo, hi;
  double area = 0.0;
  Bounds() {
    lo.fill(std::numeric_limits<double>::max());
    hi.fill(std::numeric_limits<double>::lowest());
  }
  void add(const std::array<double, 6>& k, double a) {
    for (std::size_t i = 0; i < 6; ++i) lo[i] = std::min(lo[i], k[i]), hi[i] = std::max(hi[i], k[i]);
    area += a;
  }
  void add(const Bounds& b) {
    for (std::size_t i = 0; i < 6; ++i) lo[i] = std::min(lo[i], b.lo[i]), hi[i] = std::max(hi[i], b.hi[i]);
    area += b.area;
  }
  /// Area times squared size: what is left of the variance in a part.
  double cost(double normalScale) const {
    double d = 0.0;
    for (std::size_t i = 0; i < 6; ++i) {
      const double e = std::max(0.0, hi[i] - lo[i]) * (i < 3 ? 1.0 : normalScale);
      d += e * e;
    }
    return area * d;
  }
};

class Builder {
 public:
  Builder(ClusterTree& tree, const std::vector<Shape>& shapes) : tree_(tree), shapes_(shapes) {}

  void build() {
    tree_.nodes.push_back({});
    tree_.nodes[0].count = std::uint32_t(tree_.order.size());
    std::vector<std::pair<std::uint32_t, int>> open{{0, 0}};
    while (!open.empty()) {
      const auto [id, depth] = open.back();
      open.pop_back();
      const std::uint32_t first = tree_.nodes[id].first, count = tree_.nodes[id].count;
      if (count < 2) continue;
      const std::uint32_t left = split(first, count, depth);
      const auto child = std::uint32_t(tree_.nodes.size());
      tree_.nodes[id].child = child;
      for (const auto& [f, c] : {std::pair{first, left}, std::pair{first + left, count - left}}) {
        Cluster n;
        n.first = f;
        n.count = c;
        n.parent = id;
        tree_.nodes.push_back(n);
      }
      open.emplace_back(child + 1, depth + 1);
      open.emplace_back(child, depth + 1);
    }
  }

 private:
  /// Puts the first part of [first, first + count) in front and returns its size.
  std::uint32_t split(std::uint32_t first, std::uint32_t count, int depth) {
    const auto begin = tree_.order.begin() + first, end = begin + count;
    Bounds all;
    for (auto it = begin; it != end; ++it) all.add(shapes_[*it].key, shapes_[*it].area);
    double diagonal = 0.0;
    for (std::size_t i = 0; i < 3; ++i) diagonal += (all.hi[i] - all.lo[i]) * (all.hi[i] - all.lo[i]);
    const double scale = kNormalScale * std::sqrt(diagonal);
    double best = std::numeric_limits<double>::max();
    std::size_t bestKey = 6;
    int bestBin = 0;
    const auto binOf = [&](std::uint32_t patch, std::size_t k) {
      return std::clamp(int(kBins * (shapes_[patch].key[k] - all.lo[k]) / (all.hi[k] - all.lo[k])), 0, kBins - 1);
    };
    for (std::size_t k = 0; k < 6 && depth < kBalancedFrom; ++k) {
      if (!(all.hi[k] - all.lo[k] > 1e-9 * (k < 3 ? std::sqrt(diagonal) : 1e3))) continue;
      std::array<Bounds, kBins> bins;
      for (auto it = begin; it != end; ++it) bins[std::size_t(binOf(*it, k))].add(shapes_[*it].key, shapes_[*it].area);
      std::array<double, kBins> right{};
      Bounds sum;
      for (int b = kBins - 1; b > 0; --b) {
        sum.add(bins[std::size_t(b)]);
        right[std::size_t(b)] = sum.area > 0.0 ? sum.cost(scale) : -1.0;
      }
      sum = {};
      for (int b = 1; b < kBins; ++b) {
        sum.add(bins[std::size_t(b) - 1]);
        if (!(sum.area > 0.0) || right[std::size_t(b)] < 0.0) continue;
        const double cost = sum.cost(scale) + right[std::size_t(b)];
        if (cost < best) best = cost, bestKey = k, bestBin = b;
      }
    }
    if (bestKey < 6)
      return std::uint32_t(std::stable_partition(begin, end, [&](std::uint32_t p) { return binOf(p, bestKey) < bestBin; }) - begin);
    // All alike, or too deep: halves by the longest axis of space, then by number.
    std::size_t axis = 0;
    for (std::size_t k = 1; k < 3; ++k)
      if (all.hi[k] - all.lo[k] > all.hi[axis] - all.lo[axis]) axis = k;
    std::sort(begin, end,
              [&](std::uint32_t a, std::uint32_t b) { return std::pair(shapes_[a].key[axis], a) < std::pair(shapes_[b].key[axis], b); });
    return count / 2;
  }

  ClusterTree& tree_;
  const std::vector<Shape>& shapes_;
};

}  // namespace

std::pair<std::uint32_t, float> ClusterTree::pick(const Cluster& c, float u) const {
  if (c.count == 1) return {c.first, u};
  const double from = areaBefore[c.first], at = from + double(u) * (areaBefore[c.first + c.count] - from);
  const auto begin = areaBefore.begin() + c.first + 1, end = areaBefore.begin() + c.first + c.count;
  auto i = std::uint32_t(std::upper_bound(begin, end, at) - areaBefore.begin()) - 1;
  while (i > c.first && !(areaBefore[i + 1] > areaBefore[i])) --i;  // the last ones of the node may have no area
  const double rest = (at - areaBefore[i]) / (areaBefore[i + 1] - areaBefore[i]);
  return {i, std::clamp(float(rest), 0.0f, 0x1.fffffep-1f)};
}

ClusterTree makeClusters(const Scene& scene, const PatchMesh& mesh, const Run& run) {
  ClusterTree tree;
  tree.leafOf.assign(mesh.patches.size(), kNone);
  std::vector<Shape> shapes(mesh.patches.size());
  const Run quiet = run.quiet();
  parallelFor(quiet, mesh.patches.size(), 256, [&](std::size_t i) {
    const Patch& p = mesh.patches[i];
    Shape& s = shapes[i];
    s.area = p.area_m2;
    std::vector<glm::dvec3> normals;
    for (std::uint32_t k = 0; k < p.leafCount; ++k) {
      const auto c = leafCorners(scene, mesh.leaves[p.firstLeaf + k], p.back);
      const glm::dvec3 n = glm::cross(c[1] - c[0], c[2] - c[0]);
      s.normal += n;
      if (glm::length(n) > 0.0) normals.push_back(n);
      for (const glm::dvec3& v : c) s.lo = glm::min(s.lo, glm::vec3(v)), s.hi = glm::max(s.hi, glm::vec3(v));
    }
    s.normal = glm::length(s.normal) > 0.0 ? glm::normalize(s.normal) : p.normal;
    for (const glm::dvec3& n : normals) s.spread = std::max(s.spread, angle(n, s.normal));
    const glm::dvec3 centre = 0.5 * (glm::dvec3(s.lo) + glm::dvec3(s.hi));
    for (int k = 0; k < 3; ++k) s.key[std::size_t(k)] = centre[k], s.key[std::size_t(k) + 3] = s.normal[k];
  });
  // Patches without area (wholly inside solids) exchange nothing, but they are there for the shafts of partition.h.
  for (std::uint32_t i = 0; i < mesh.patches.size(); ++i) tree.order.push_back(i);
  if (tree.order.empty()) return tree;
  tree.nodes.reserve(2 * tree.order.size());
  Builder(tree, shapes).build();

  tree.areaBefore.resize(tree.order.size() + 1, 0.0);
  for (std::size_t k = 0; k < tree.order.size(); ++k) tree.areaBefore[k + 1] = tree.areaBefore[k] + shapes[tree.order[k]].area;
  // Upwards: boxes, areas, cones. A cone of two cones: about the half of their outermost normals' angle.
  std::vector<double> half(tree.nodes.size());
  std::vector<glm::dvec3> centroid(tree.nodes.size()), normal(tree.nodes.size());  // area means
  std::vector<glm::dvec3> axis(tree.nodes.size());
  for (std::size_t id = tree.nodes.size(); id-- > 0;) {
    Cluster& n = tree.nodes[id];
    if (n.isLeaf()) {
      const Shape& s = shapes[tree.order[n.first]];
      n.lo_m = s.lo;
      n.hi_m = s.hi;
      axis[id] = s.normal;
      half[id] = s.spread;
      centroid[id] = mesh.patches[tree.order[n.first]].centre_m;
      normal[id] = s.normal;
      tree.leafOf[tree.order[n.first]] = std::uint32_t(id);
    } else {
      const Cluster &a = tree.nodes[n.child], &b = tree.nodes[n.child + 1];
      n.lo_m = glm::min(a.lo_m, b.lo_m);
      n.hi_m = glm::max(a.hi_m, b.hi_m);
      const double between = angle(axis[n.child], axis[n.child + 1]), ha = half[n.child], hb = half[n.child + 1];
      if (between + hb <= ha) {
        axis[id] = axis[n.child];
        half[id] = ha;
      } else if (between + ha <= hb) {
        axis[id] = axis[n.child + 1];
        half[id] = hb;
      } else {
        half[id] = 0.5 * (between + ha + hb);
        const double turn = half[id] - ha;  // from a's axis towards b's
        const glm::dvec3 side = axis[n.child + 1] - glm::dot(axis[n.child + 1], axis[n.child]) * axis[n.child];
        axis[id] = glm::length(side) > 1e-12 ? glm::normalize(std::cos(turn) * axis[n.child] + std::sin(turn) * glm::normalize(side))
                                             : axis[n.child];
        if (half[id] > 3.0) half[id] = 3.15;
      }
    }
    n.area_m2 = tree.areaBefore[n.first + n.count] - tree.areaBefore[n.first];
    if (!n.isLeaf()) {
      const double whole = tree.nodes[n.child].area_m2 + tree.nodes[n.child + 1].area_m2;
      const double share = whole > 0.0 ? tree.nodes[n.child].area_m2 / whole : 0.5;
      centroid[id] = share * centroid[n.child] + (1.0 - share) * centroid[n.child + 1];
      normal[id] = share * normal[n.child] + (1.0 - share) * normal[n.child + 1];
    }
    n.centroid_m = glm::vec3(centroid[id]);
    n.centre_m = 0.5f * (n.lo_m + n.hi_m);
    n.radius_m = std::nextafter(float(0.5 * glm::length(glm::dvec3(n.hi_m) - glm::dvec3(n.lo_m))) * (1.0f + 1e-6f), INFINITY);
    n.axis = glm::vec3(axis[id]);
    // Rounded outwards by more than what float loses: a cone too wide is slower, one too narrow is wrong.
    n.cosine = half[id] >= 3.14 ? -1.0f : float(std::cos(std::min(3.1415, half[id]))) - 1e-7f;
  }
  tree.places.resize(tree.nodes.size());
  parallelFor(quiet, tree.nodes.size(), 64, [&](std::size_t id) {
    const Cluster& n = tree.nodes[id];
    auto& places = tree.places[id];
    if (n.isLeaf()) {
      const Patch& p = mesh.patches[tree.patchOf(n)];
      constexpr std::array<glm::vec2, kPlaces> kU{{{0.25f, 0.25f}, {0.75f, 0.75f}, {0.25f, 0.75f}, {0.75f, 0.25f}}};
      for (std::size_t m = 0; m < kPlaces; ++m) {
        const auto [triangle, bary] = mesh.sample(p, kU[m]);
        const SurfacePoint s = surfacePoint(scene, triangle, bary);
        places[m] = {glm::vec3(s.position_m), glm::vec3(p.back ? -s.geometricNormal : s.geometricNormal), 1.0f / float(kPlaces), {}};
      }
      return;
    }
    if (!(n.area_m2 > 0.0)) return;
    std::size_t m = 0;
    const auto add = [&](std::uint32_t part) {
      const Cluster& c = tree.nodes[part];
      if (!(c.area_m2 > 0.0)) return;
      Place& p = places[m++];
      p.share = float(c.area_m2 / n.area_m2);
      p.position_m = c.centroid_m;
      p.normal = glm::vec3(normal[part]);
      if (c.cosine > kBent) return;
      // Faces that look every way have no place in the middle: one of the patches stands for them.
      const Patch& patch = mesh.patches[tree.order[tree.pick(c, 0.5f).first]];
      p.position_m = glm::vec3(patch.centre_m);
      p.normal = glm::vec3(patch.normal);
    };
    for (const std::uint32_t c : {n.child, n.child + 1}) {
      if (tree.nodes[c].isLeaf()) {
        add(c);
      } else {
        add(tree.nodes[c].child);
        add(tree.nodes[c].child + 1);
      }
    }
    // Gradient by least squares, C g = sum share (x - c) value; a little of the unit matrix where the places lie in a plane or a line.
    glm::dmat3 C(0.0);
    for (const Place& p : places) {
      const glm::dvec3 x = (glm::dvec3(p.position_m) - centroid[id]) / double(n.radius_m);
      C += double(p.share) * glm::outerProduct(x, x);
    }
    const double ridge = 1e-3 * (C[0][0] + C[1][1] + C[2][2]) + 1e-30;
    for (int k = 0; k < 3; ++k) C[k][k] += ridge;
    const glm::dmat3 inverse = glm::inverse(C);
    for (Place& p : places) p.slope = p.share * glm::vec3(inverse * ((glm::dvec3(p.position_m) - centroid[id]) / double(n.radius_m)));
  });
  // How thick a cluster is along its own axis: exact for flat ones, however they lie in space.
  parallelFor(quiet, tree.nodes.size(), 64, [&](std::size_t id) {
    Cluster& n = tree.nodes[id];
    double lowest = std::numeric_limits<double>::max(), highest = std::numeric_limits<double>::lowest();
    if (n.cosine < 0.9f || n.count > kThickest) {
      const double c = glm::dot(glm::dvec3(n.centre_m), glm::dvec3(n.axis));
      lowest = c - double(n.radius_m);
      highest = c + double(n.radius_m);
    } else {
      for (std::uint32_t k = n.first; k < n.first + n.count; ++k) {
        const Patch& p = mesh.patches[tree.order[k]];
        for (std::uint32_t l = 0; l < p.leafCount; ++l)
          for (const glm::dvec3& c : leafCorners(scene, mesh.leaves[p.firstLeaf + l], p.back)) {
            const double d = glm::dot(c, glm::dvec3(n.axis));
            lowest = std::min(lowest, d);
            highest = std::max(highest, d);
          }
      }
    }
    const double ulp = double(scene.extent_m) * 0x1p-23;
    n.lowest_m = float(lowest - ulp);
    n.highest_m = float(highest + ulp);
  });
  return tree;
}

std::vector<std::uint32_t> parts(const ClusterTree& tree, std::size_t patches) {
  std::vector<std::uint32_t> out;
  for (std::uint32_t id = 0; id < tree.nodes.size(); ++id) {
    const Cluster& n = tree.nodes[id];
    if (n.count <= patches && (n.parent == kNone || tree.nodes[n.parent].count > patches)) out.push_back(id);
  }
  return out;
}

}  // namespace lmc
