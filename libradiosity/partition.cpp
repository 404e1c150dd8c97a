#include "libradiosity/partition.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "libradiosity/visibility.h"
#include "libscene/constants.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"

namespace lmc {

namespace {

constexpr double kSlackUlps = 16.0;         // of the level's extent: rays start 4 ulp off their surface, offsets are rounded to float
constexpr std::size_t kMostOccluders = 64;  // the largest ones
constexpr double kLeastOccluder = 1e-4;     // of the level's area
constexpr std::uint32_t kOccluderPatches = 4096;
constexpr int kVisits = 64;  // nodes that an empty shaft may cost
constexpr std::uint32_t kOccluderChecks = 64;
constexpr std::size_t kMostSets = 65536;  // of cells, of different nodes; further ones count as looking everywhere

double supportOfBox(const Cluster& c, const glm::dvec3& d) {
  double s = 0.0;
  for (int k = 0; k < 3; ++k) s += d[k] * double(d[k] > 0.0 ? c.hi_m[k] : c.lo_m[k]);
  return s;
}

/// Upper bound of dot(d, x) over the places x of the cluster, d a unit vector: by its box, or by its own thickness where it is about
/// parallel to d (a slanted wall fills its box badly).
double highestAlong(const Cluster& c, const glm::dvec3& d) {
  double best = supportOfBox(c, d);
  if (c.cosine < 0.9f) return best;
  const glm::dvec3 axis(c.axis);
  for (const double sign : {1.0, -1.0}) {
    const glm::dvec3 rest = d - sign * axis;
    const double off = glm::dot(rest, glm::dvec3(c.centre_m)) + glm::length(rest) * double(c.radius_m);
    best = std::min(best, (sign > 0.0 ? double(c.highest_m) : -double(c.lowest_m)) + off);
  }
  return best;
}
double lowestAlong(const Cluster& c, const glm::dvec3& d) { return -highestAlong(c, -d); }

/// All of b behind every face of a: n.(x - y) <= slack for n in a's cone, x in b, y in a.
bool behind(const Cluster& a, const Cluster& b, double slack) {
  if (a.cosine <= 0.0f) return false;
  const glm::dvec3 axis(a.axis);
  const double c = double(a.cosine), tilt = std::sqrt(std::max(0.0, 2.0 - 2.0 * c));  // |n - axis| at most
  const glm::dvec3 between = glm::dvec3(b.centre_m) - glm::dvec3(a.centre_m);
  const double reach = glm::length(between) + double(a.radius_m) + double(b.radius_m);
  if (highestAlong(b, axis) - double(a.lowest_m) + (tilt > 1e-3 ? tilt * reach : 0.0) <= slack) return true;
  // By angles: between the axis and any x - y there is at least the angle of the centres less that of a sphere of both radii.
  const double d = glm::length(between), r = double(a.radius_m) + double(b.radius_m);
  if (d <= r) return false;
  const double angle = std::acos(std::clamp(glm::dot(axis, between) / d, -1.0, 1.0)) - std::asin(r / d) - std::acos(c);
  return angle > 0.5 * kPi + 1e-6;
}

/// Convex hull of two boxes: their common box and planes along an axis that touch an edge of either.
struct Shaft {
  glm::dvec3 lo, hi;
  std::array<glm::dvec3, 12> normal;
  std::array<double, 12> offset{};
  std::size_t planes = 0;

  Shaft(const Cluster& a, const Cluster& b) : lo(glm::min(a.lo_m, b.lo_m)), hi(glm::max(a.hi_m, b.hi_m)) {
    for (int w = 0; w < 3; ++w) {
      const int u = (w + 1) % 3, v = (w + 2) % 3;
      for (int corner = 0; corner < 4; ++corner) {
        const auto at = [&](const Cluster& c, int k) {
          return glm::dvec2(double((k & 1) != 0 ? c.hi_m[u] : c.lo_m[u]), double((k & 2) != 0 ? c.hi_m[v] : c.lo_m[v]));
        };
        const glm::dvec2 p = at(a, corner), e = at(b, corner) - p;
        if (e.x == 0.0 || e.y == 0.0) continue;  // a face of the common box, or nothing
        glm::dvec2 n = glm::normalize(glm::dvec2(-e.y, e.x));
        double low = 0.0, high = 0.0;
        for (int k = 0; k < 4; ++k)
          for (const Cluster* c : {&a, &b}) {
            const double d = glm::dot(n, at(*c, k) - p);
            low = std::min(low, d);
            high = std::max(high, d);
          }
        const double tolerance = 1e-12 * (std::abs(e.x) + std::abs(e.y));
        if (high > tolerance && low < -tolerance) continue;  // it cuts a box
        if (high > tolerance) n = -n;
        glm::dvec3 n3(0.0);
        n3[u] = n.x;
        n3[v] = n.y;
        normal[planes] = n3;
        offset[planes++] = glm::dot(n, p);  // inside: dot <= offset
      }
    }
  }
  bool misses(const Cluster& c, double slack) const {
    for (int k = 0; k < 3; ++k)
      if (double(c.lo_m[k]) >= hi[k] - slack || double(c.hi_m[k]) <= lo[k] + slack) {
        // A shaft without thickness (two walls of one plane) has no inside; nothing can be said of it.
        if (hi[k] - lo[k] > 4.0 * slack) return true;
      }
    for (std::size_t p = 0; p < planes; ++p)
      if (-supportOfBox(c, -normal[p]) >= offset[p] - slack) return true;
    return false;
  }
};

double cross2(const glm::dvec2& a, const glm::dvec2& b) { return a.x * b.y - a.y * b.x; }

std::vector<glm::dvec2> convexHull(std::vector<glm::dvec2> p) {
  std::sort(p.begin(), p.end(), [](const glm::dvec2& a, const glm::dvec2& b) { return std::pair(a.x, a.y) < std::pair(b.x, b.y); });
  std::vector<glm::dvec2> hull(2 * p.size());
  std::size_t k = 0;
  const auto add = [&](const glm::dvec2& c, std::size_t least) {
    while (k >= least && cross2(hull[k - 1] - hull[k - 2], c - hull[k - 2]) <= 0.0) --k;
    hull[k++] = c;
  };
  for (const glm::dvec2& c : p) add(c, 2);
  const std::size_t lower = k + 1;
  for (std::size_t i = p.size() - 1; i-- > 0;) add(p[i], lower);
  hull.resize(k > 1 ? k - 1 : k);
  return hull;
}

double areaOf(const std::vector<glm::dvec2>& p) {
  double sum = 0.0;
  for (std::size_t i = 1; i + 1 < p.size(); ++i) sum += 0.5 * cross2(p[i] - p[0], p[i + 1] - p[0]);
  return sum;
}

}  // namespace

Partition::Partition(const Scene& scene, const PatchMesh& mesh, const ClusterTree& tree, const Tracer& tracer,
                     const PartitionOptions& options, const Run& run)
    : tree_(tree), slack_m_(kSlackUlps * double(scene.extent_m) * 0x1p-23) {
  if (options.on[std::size_t(Rule::Blocked)]) findOccluders(scene, mesh, tracer);
  if (options.on[std::size_t(Rule::Cells)]) {
    cells_ = Cells(scene, double(tracer.lift_m()));
    findRooms(scene, mesh, run);
  }
}

bool Partition::averted(const Cluster& a, const Cluster& b) const { return behind(a, b, slack_m_) || behind(b, a, slack_m_); }

bool Partition::apart(std::uint32_t a, std::uint32_t b) const {
  if (sets_.empty()) return false;
  const std::size_t words = cells_.words();
  const std::uint64_t *seen = &sets_[(2 * std::size_t(setOf_[a]) + 1) * words], *there = &sets_[2 * std::size_t(setOf_[b]) * words];
  for (std::size_t w = 0; w < words; ++w)
    if ((seen[w] & there[w]) != 0) return false;
  return true;
}

bool Partition::emptyShaft(const Cluster& a, const Cluster& b) const {
  const Shaft shaft(a, b);
  std::array<std::uint32_t, kVisits + 2> stack;
  std::size_t size = 0;
  int visits = 0;
  stack[size++] = 0;
  while (size > 0) {
    const Cluster& c = tree_.nodes[stack[--size]];
    if (++visits > kVisits) return false;
    if (shaft.misses(c, slack_m_)) continue;
    if (c.cosine > 0.9f) {
      const glm::dvec3 axis(c.axis);
      if (lowestAlong(a, axis) >= double(c.highest_m) - slack_m_ && lowestAlong(b, axis) >= double(c.highest_m) - slack_m_) continue;
      if (highestAlong(a, axis) <= double(c.lowest_m) + slack_m_ && highestAlong(b, axis) <= double(c.lowest_m) + slack_m_) continue;
    }
    if (c.isLeaf()) return false;
    if (size + 2 > stack.size()) return false;
    stack[size++] = c.child + 1;
    stack[size++] = c.child;
  }
  return true;
}

void Partition::findOccluders(const Scene& scene, const PatchMesh& mesh, const Tracer& tracer) {
  struct Found {
    double area;
    std::uint32_t node;
    Occluder occluder;
  };
  std::vector<Found> found;
  double whole = 0.0;
  for (const Leaf& l : mesh.leaves) whole += double(l.area_m2);
  std::vector<bool> inside(tree_.nodes.size(), false);  // a part of an occluder says nothing more
  for (std::uint32_t id = 0; id < tree_.nodes.size(); ++id) {
    const Cluster& n = tree_.nodes[id];
    inside[id] = n.parent != kNone && inside[n.parent];
    if (inside[id] || !n.flat() || n.count > kOccluderPatches) continue;
    Occluder o;
    o.normal = glm::normalize(glm::dvec3(n.axis));
    o.lowest = double(n.lowest_m);
    o.highest = double(n.highest_m);
    if (o.highest - o.lowest > 4.0 * slack_m_) continue;
    const glm::dvec3 off = std::abs(o.normal.x) < 0.5 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
    o.u = glm::normalize(glm::cross(off, o.normal));
    o.v = glm::cross(o.normal, o.u);
    std::vector<glm::dvec2> corners;
    double area = 0.0;
    bool holes = false;
    for (std::uint32_t k = n.first; k < n.first + n.count; ++k) {
      const Patch& p = mesh.patches[tree_.order[k]];
      for (std::uint32_t l = 0; l < p.leafCount; ++l) {
        const Leaf& leaf = mesh.leaves[p.firstLeaf + l];
        const auto c = leafCorners(scene, leaf, p.back);
        area += area_m2(c);
        holes = holes || scene.materialOf(leaf.triangle).alpha != Material::Alpha::Opaque;
        for (const glm::dvec3& x : c) corners.emplace_back(glm::dot(o.u, x), glm::dot(o.v, x));
      }
    }
    if (area < kLeastOccluder * whole) {
      inside[id] = true;
      continue;
    }
    if (holes) continue;
    o.corner = convexHull(std::move(corners));
    // No holes: the patches fill their hull (they are parts of one mesh and do not overlap; rays below make sure of it).
    if (std::abs(areaOf(o.corner) - area) > 1e-5 * area) continue;
    inside[id] = true;
    const Sobol4 numbers = sequence(1, Draw::Visibility, 1, 0, id, 0, 0);
    bool solid = true;
    const double total = areaOf(o.corner), plane = 0.5 * (o.lowest + o.highest);
    for (std::uint32_t k = 0; k < kOccluderChecks && solid; ++k) {
      const glm::vec4 u = numbers.point(k);
      double target = double(u.x) * total;
      for (std::size_t i = 1; i + 1 < o.corner.size(); ++i) {
        const glm::dvec2 e = o.corner[i] - o.corner[0], f = o.corner[i + 1] - o.corner[0];
        const double part = 0.5 * cross2(e, f);
        if (target > part && i + 2 < o.corner.size()) {
          target -= part;
          continue;
        }
        const double s = std::sqrt(double(u.y)), t = double(u.z);
        const glm::dvec2 at = o.corner[0] + s * (1.0 - t) * e + s * t * f;
        const glm::dvec3 x = at.x * o.u + at.y * o.v + plane * o.normal;
        const double reach = 4.0 * slack_m_;
        solid = tracer.occluded(Ray{glm::vec3(x + reach * o.normal), glm::vec3(-2.0 * reach * o.normal), 1.0f}, Purpose::Visibility);
        break;
      }
    }
    if (solid) found.push_back({area, id, std::move(o)});
  }
  std::sort(found.begin(), found.end(),
            [](const Found& a, const Found& b) { return std::pair(-a.area, a.node) < std::pair(-b.area, b.node); });
  if (found.size() > kMostOccluders) found.resize(kMostOccluders);
  for (Found& f : found) occluders_.push_back(std::move(f.occluder));
}

bool Partition::blockedShaft(const Cluster& a, const Cluster& b) const {
  for (const Occluder& o : occluders_) {
    // The plane first: one wholly above it, one wholly below.
    const bool aAbove = lowestAlong(a, o.normal) > o.highest + slack_m_, bAbove = lowestAlong(b, o.normal) > o.highest + slack_m_;
    if (aAbove == bAbove) continue;
    if (!(highestAlong(aAbove ? b : a, o.normal) < o.lowest - slack_m_)) continue;
    // A box reaches beyond its slanted cluster, maybe through the plane: then segments of corners do not cross it.
    const double plane = 0.5 * (o.lowest + o.highest);
    bool cut = true;
    for (int i = 0; i < 8 && cut; ++i)
      for (int j = 0; j < 8 && cut; ++j) {
        const glm::dvec3 x(double((i & 1) != 0 ? a.hi_m.x : a.lo_m.x), double((i & 2) != 0 ? a.hi_m.y : a.lo_m.y),
                           double((i & 4) != 0 ? a.hi_m.z : a.lo_m.z)),
            y(double((j & 1) != 0 ? b.hi_m.x : b.lo_m.x), double((j & 2) != 0 ? b.hi_m.y : b.lo_m.y),
              double((j & 4) != 0 ? b.hi_m.z : b.lo_m.z));
        const double dx = glm::dot(x, o.normal) - plane, dy = glm::dot(y, o.normal) - plane;
        if (!(aAbove ? dx > 0.0 && dy < 0.0 : dx < 0.0 && dy > 0.0)) {
          cut = false;
          break;
        }
        const glm::dvec3 at = x + (y - x) * (dx / (dx - dy));
        const glm::dvec2 q(glm::dot(o.u, at), glm::dot(o.v, at));
        for (std::size_t k = 0; k < o.corner.size() && cut; ++k) {
          const glm::dvec2 &c = o.corner[k], e = o.corner[(k + 1) % o.corner.size()] - c;
          cut = cross2(e, q - c) >= slack_m_ * glm::length(e);
        }
      }
    if (cut) return true;
  }
  return false;
}

void Partition::findRooms(const Scene& scene, const PatchMesh& mesh, const Run& run) {
  const std::size_t words = cells_.words();
  if (words == 0 || tree_.nodes.empty()) return;
  using Set = std::vector<std::uint64_t>;
  std::vector<Set> looked(mesh.patches.size(), Set(words, 0));
  const Run quiet = run.quiet();
  parallelFor(quiet, mesh.patches.size(), 64, [&](std::size_t i) {
    const Patch& p = mesh.patches[i];
    for (std::uint32_t l = 0; l < p.leafCount; ++l) cells_.addCellsOf(leafCorners(scene, mesh.leaves[p.firstLeaf + l], p.back), looked[i]);
  });
  // Most nodes share their set with many others.
  std::map<Set, std::uint32_t> number;
  std::vector<const Set*> sets;
  Set everywhere(words, 0);
  for (const Set& s : looked)
    for (std::size_t w = 0; w < words; ++w) everywhere[w] |= s[w];
  const auto numberOf = [&](const Set& s) {
    if (sets.size() >= kMostSets && !number.contains(s)) return number.at(everywhere);
    const auto [it, isNew] = number.try_emplace(s, std::uint32_t(sets.size()));
    if (isNew) sets.push_back(&it->first);
    return it->second;
  };
  numberOf(everywhere);
  setOf_.resize(tree_.nodes.size());
  for (std::size_t id = tree_.nodes.size(); id-- > 0;) {
    const Cluster& n = tree_.nodes[id];
    if (n.isLeaf()) {
      setOf_[id] = numberOf(looked[tree_.patchOf(n)]);
      continue;
    }
    Set both = *sets[setOf_[n.child]];
    for (std::size_t w = 0; w < words; ++w) both[w] |= (*sets[setOf_[n.child + 1]])[w];
    setOf_[id] = numberOf(both);
  }
  bool apartSomewhere = false;
  for (const Set* s : sets) {
    Set seen(words, 0);
    cells_.addSeen(*s, seen);
    for (std::size_t w = 0; w < words; ++w) apartSomewhere = apartSomewhere || (everywhere[w] & ~seen[w]) != 0;
    sets_.insert(sets_.end(), s->begin(), s->end());
    sets_.insert(sets_.end(), seen.begin(), seen.end());
  }
  if (!apartSomewhere) sets_.clear();
}

}  // namespace lmc
