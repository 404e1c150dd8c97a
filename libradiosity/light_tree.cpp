#include "libradiosity/light_tree.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <queue>
#include <span>

#include "libradiosity/lights.h"
#include "libscene/constants.h"

namespace lmc {

namespace {

constexpr std::size_t kFewLights = 24;  // are all asked by themselves
constexpr double kAlone = 0.02;         // of all that might be given: from here on a light is asked by itself
constexpr std::size_t kMostAlone = 32;
constexpr double kFine = 0.0005;      // of all that might be given: groups of less are not parted
constexpr double kAlikeCosine = 0.9;  // to the axis, of emitters that shine alike
constexpr double kCompact = 0.25;     // radius over distance: below it lights of a node that shine alike are chosen by strength
constexpr double kLeast2_m2 = 1e-12;  // square of the least distance to a lamp
constexpr double kHemisphere = kPi / 2.0;

double angleBetween(const glm::dvec3& a, const glm::dvec3& b) { return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b)); }

/// Emitters by the axis that they face most: of those on a closed body or a double-sided sheet half look away from any place.
int facing(const glm::dvec3& n) {
  const glm::dvec3 size = glm::abs(n);
  const int side = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  return 1 + 2 * side + (n[side] < 0.0);
}

/// Part of a cumulative sum that `pick` falls into.
std::size_t partAt(std::span<const double> begins, double pick) {
  return std::size_t(std::ranges::upper_bound(begins, pick) - begins.begin()) - 1;
}

constexpr double kBelowOne = 1.0 - 1e-9;

}  // namespace

void LightTree::measure(Node& n, const Extent& e) {
  n.lo_m = e.lo;
  n.hi_m = e.hi;
  n.centre_m = 0.5 * (e.lo + e.hi);
  n.radius_m = 0.5 * glm::length(e.hi - e.lo);
  n.spread = Angle::of(e.spread_rad);
  n.cover = n.spread + Angle::of(e.cone_rad);
  n.alike = n.flat ? n.spread.cos >= kAlikeCosine : e.leastCone_rad >= kPi;
}

/// The largest product of the cosines at both ends that any light of the node, within `reach` of its middle, can have with a receiver.
double LightTree::mostCosines(const Node& n, const glm::dvec3& to, double distance, double reach, const glm::dvec3& normal,
                              const Angle& bend) {
  if (distance <= reach) return 1.0;
  const double part = reach / distance;
  const Angle width{std::sqrt(1.0 - part * part), part};  // half the angle under which the node's sphere is seen
  const glm::dvec3 way = to / distance;
  double cosines = 1.0;
  if (normal != glm::dvec3(0.0)) {
    cosines = Angle::between(normal, way).cosBeyond(width + bend);
    if (cosines <= 0.0) return 0.0;
  }
  const Angle off = Angle::between(n.axis, -way);
  if (off.cos < (n.cover + width).cos - 1e-9) return 0.0;
  return n.flat ? cosines * std::max(0.0, off.cosBeyond(n.spread + width)) : cosines;
}

LightTree::LightTree(const Scene& scene, const Emitters& emitters) : punctualCount_(std::uint32_t(scene.lights.size())) {
  std::vector<Leaf> leaves;
  const auto add = [&](Leaf leaf, std::uint32_t light) {
    if (!(leaf.node.strength > 0.0)) return;
    leaf.light = light;
    leaf.extent.leastCone_rad = leaf.extent.cone_rad;
    leaf.node.count = 1;
    measure(leaf.node, leaf.extent);
    leaves.push_back(leaf);
  };
  for (std::uint32_t i = 0; i < scene.lights.size(); ++i) {
    const Light& l = scene.lights[i];
    if (l.kind == Light::Kind::Directional || l.classic) {
      always_.push_back(i);
      continue;
    }
    Leaf leaf;
    leaf.extent.lo = leaf.extent.hi = l.position_m;
    leaf.extent.cone_rad = l.kind == Light::Kind::Spot ? std::acos(std::clamp(l.cosOuter, -1.0, 1.0)) : kPi;
    leaf.node.axis = l.direction;
    leaf.node.strength = double(strength(l.intensity));
    leaf.node.most_lx = INFINITY;
    leaf.node.range_m = l.range_m;
    add(leaf, i);
  }
  for (std::uint32_t e = 0; e < emitters.whole.size(); ++e) {
    const Emitter& emitter = emitters.whole[e];
    Leaf leaf;
    for (const glm::dvec3& c : emitter.corner_m) {
      leaf.extent.lo = glm::min(leaf.extent.lo, c);
      leaf.extent.hi = glm::max(leaf.extent.hi, c);
    }
    leaf.extent.cone_rad = kHemisphere;
    leaf.node.axis = emitter.normal;
    leaf.node.flat = true;
    leaf.node.strength = emitter.area_m2 * double(strength(emitter.radiance));
    leaf.node.most_lx = 2.0 * kPi * double(strength(emitter.radiance));
    leaf.kind = facing(emitter.normal);
    add(leaf, punctualCount_ + e);
  }
  if (leaves.empty()) return;
  std::ranges::stable_sort(leaves, {}, &Leaf::kind);
  nodes_.reserve(2 * leaves.size());
  nodes_.emplace_back();
  build(0, leaves, 0, leaves.size());
  before_.push_back(0.0);
  for (const Leaf& leaf : leaves) {
    lights_.push_back(leaf.light);
    before_.push_back(before_.back() + leaf.node.strength);
  }
}

LightTree::Extent LightTree::build(std::uint32_t node, std::vector<Leaf>& leaves, std::size_t begin, std::size_t end) {
  if (end - begin == 1) {
    nodes_[node] = leaves[begin].node;
    nodes_[node].first = std::uint32_t(begin);
    return leaves[begin].extent;
  }
  const auto first = leaves.begin() + std::ptrdiff_t(begin), last = leaves.begin() + std::ptrdiff_t(end);
  std::size_t middle = begin + (end - begin) / 2;
  if (first->kind != (last - 1)->kind) {
    // Where kinds meet, as near the middle as can be.
    const int kind = leaves[middle].kind;
    const auto lower = std::ranges::lower_bound(first, last, kind, {}, &Leaf::kind);
    const auto upper = std::ranges::upper_bound(first, last, kind, {}, &Leaf::kind);
    const std::size_t below = std::size_t(lower - leaves.begin()), above = std::size_t(upper - leaves.begin());
    middle = above == end || (below != begin && middle - below < above - middle) ? below : above;
  } else {
    // Halved at the median of the middles along the longest side.
    glm::dvec3 lo(1e300), hi(-1e300);
    for (auto it = first; it != last; ++it) {
      lo = glm::min(lo, it->node.centre_m);
      hi = glm::max(hi, it->node.centre_m);
    }
    const glm::dvec3 size = hi - lo;
    const int side = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    std::stable_sort(first, last, [side](const Leaf& a, const Leaf& b) { return a.node.centre_m[side] < b.node.centre_m[side]; });
  }
  const std::uint32_t child = std::uint32_t(nodes_.size());
  nodes_.resize(nodes_.size() + 2);
  const Extent left = build(child, leaves, begin, middle), right = build(child + 1, leaves, middle, end);
  const Node &a = nodes_[child], &b = nodes_[child + 1];
  Node n;
  n.child = child;
  n.first = a.first;
  n.count = a.count + b.count;
  n.strength = a.strength + b.strength;
  n.most_lx = a.most_lx + b.most_lx;
  n.range_m = a.range_m > 0.0 && b.range_m > 0.0 ? std::max(a.range_m, b.range_m) : 0.0;
  n.flat = a.flat && b.flat;
  const glm::dvec3 axis = a.strength * a.axis + b.strength * b.axis;
  const double length = glm::length(axis);
  n.axis = length > 1e-12 * n.strength ? axis / length : a.axis;
  Extent e;
  e.lo = glm::min(left.lo, right.lo);
  e.hi = glm::max(left.hi, right.hi);
  e.cone_rad = std::max(left.cone_rad, right.cone_rad);
  e.leastCone_rad = std::min(left.leastCone_rad, right.leastCone_rad);
  e.spread_rad = std::min(kPi, std::max(angleBetween(n.axis, a.axis) + left.spread_rad, angleBetween(n.axis, b.axis) + right.spread_rad));
  measure(n, e);
  nodes_[node] = n;
  return e;
}

LightTree::Bound LightTree::bound(const Node& n, const Receivers& r) {
  const glm::dvec3 to = n.centre_m - r.centre_m;
  // To the box, not to its middle: the boxes of a node's two halves lie in its own, so that what bounds them adds up to about what bounds
  // it.
  const double gap = std::max(0.0, glm::distance(r.centre_m, glm::clamp(r.centre_m, n.lo_m, n.hi_m)) - r.radius_m);
  const double window = n.range_m > 0.0 ? rangeWindow(gap, n.range_m) : 1.0;
  if (window <= 0.0) return {};
  const double cosines = mostCosines(n, to, glm::length(to), n.radius_m + r.radius_m, r.normal, Angle::of(std::min(r.bend_rad, kPi)));
  if (cosines <= 0.0) return {};
  const double byDistance = n.strength * cosines / std::max(gap * gap, kLeast2_m2);
  return {window * std::min(n.most_lx, byDistance), gap <= 0.0 || byDistance >= n.most_lx};
}

double LightTree::estimate(const Node& n, const Receivers& r) {
  const glm::dvec3 to = n.centre_m - r.centre_m;
  const double distance2 = glm::dot(to, to), distance = std::sqrt(distance2);
  const double window = n.range_m > 0.0 ? rangeWindow(std::max(0.0, distance - n.radius_m), n.range_m) : 1.0;
  if (window <= 0.0) return 0.0;
  return window * n.strength * mostCosines(n, to, distance, n.radius_m, r.normal, {}) /
         std::max({distance2, n.radius_m * n.radius_m, kLeast2_m2});
}

LightCut LightTree::cutFor(const Receivers& r, std::size_t mostNodes) const {
  assert(mostNodes <= kMostNodes);
  LightCut cut;
  cut.punctual = always_;
  if (nodes_.empty()) return cut;
  const bool few = nodes_[0].count <= kFewLights;
  struct Entry {
    double most;
    std::uint32_t id;
    bool touching;
  };
  const auto less = [](const Entry& a, const Entry& b) { return a.most != b.most ? a.most < b.most : a.id > b.id; };
  std::priority_queue<Entry, std::vector<Entry>, decltype(less)> open(less);
  std::vector<Entry> leaves;
  double total = 0.0;  // of all but lights that touch the sphere
  const auto add = [&](std::uint32_t id) {
    const Bound b = bound(nodes_[id], r);
    if (b.most <= 0.0) return;
    const bool leaf = nodes_[id].child == kNone;
    if (!(leaf && b.touching)) total += b.most;
    if (leaf)
      leaves.push_back({b.most, id, b.touching});
    else
      open.push({b.most, id, b.touching});
  };
  add(0);
  while (!open.empty() && (few || (leaves.size() + open.size() < mostNodes && open.top().most > kFine * total))) {
    const Entry whole = open.top();
    open.pop();
    total -= whole.most;
    add(nodes_[whole.id].child);
    add(nodes_[whole.id].child + 1);
  }
  std::ranges::sort(leaves, [&](const Entry& a, const Entry& b) { return less(b, a); });
  std::size_t alone = 0;
  for (const auto& [most, id, touching] : leaves) {
    if (!few && (alone >= kMostAlone || !(touching || most >= kAlone * total))) {
      cut.groups.push_back(id);
      continue;
    }
    ++alone;
    const std::uint32_t light = lights_[nodes_[id].first];
    if (light < punctualCount_)
      cut.punctual.push_back(light);
    else
      cut.emitters.push_back(light - punctualCount_);
  }
  for (; !open.empty(); open.pop()) cut.groups.push_back(open.top().id);
  std::ranges::sort(cut.punctual);
  std::ranges::sort(cut.emitters);
  std::ranges::sort(cut.groups, {}, [&](std::uint32_t id) { return nodes_[id].first; });
  return cut;
}

LightTree::Groups::Groups(const LightTree& tree, const LightCut& cut, const Receivers& r)
    : tree_(tree), cut_(cut), begin_(cut.groups.size() + 1) {
  thread_local std::vector<Bound> bounds;
  bounds.clear();
  double given = 0.0, most = 0.0;
  for (std::size_t g = 0; g < cut.groups.size(); ++g) {
    const Node& n = tree.nodes_[cut.groups[g]];
    bounds.push_back(bound(n, r));
    begin_[g] = bounds[g].most > 0.0 ? estimate(n, r) : 0.0;
    given += begin_[g];
    most += bounds[g].most;
  }
  if (!(most > 0.0)) return;
  mostWeight_ = most / kByBound;
  double touching = 0.0;
  for (std::size_t g = 0; g < cut.groups.size(); ++g) {
    const double byGiven = given > 0.0 ? begin_[g] / given : 0.0, share = (1.0 - kByBound) * byGiven + kByBound * bounds[g].most / most;
    begin_[g] = total_;
    if (bounds[g].touching) {
      touch_.push_back(cut.groups[g]);
      touching += share;
    } else {
      total_ += share;
    }
  }
  begin_.back() = total_;
  total_ += touching;
}

std::uint32_t LightTree::Groups::groupOf(const Receivers& here, double& u, std::size_t& g, double& share) const {
  const double pick = u * total_;
  if (begin_[g] > pick) g = 0;
  while (g + 1 < begin_.size() && begin_[g + 1] <= pick) ++g;
  const double part = (g + 1 < begin_.size() ? begin_[g + 1] : total_) - begin_[g];
  share = part / total_;
  u = std::min((pick - begin_[g]) / part, kBelowOne);
  if (g < cut_.groups.size()) return cut_.groups[g];
  thread_local std::vector<double> mosts;
  mosts.clear();
  double sum = 0.0;
  for (const std::uint32_t id : touch_) {
    mosts.push_back(sum);
    sum += bound(tree_.nodes_[id], here).most;
  }
  if (!(sum > 0.0)) return kNone;
  const std::size_t k = partAt(mosts, u * sum);
  const double own = (k + 1 < mosts.size() ? mosts[k + 1] : sum) - mosts[k];
  if (!(own > 0.0)) return kNone;
  share *= own / sum;
  u = std::clamp((u * sum - mosts[k]) / own, 0.0, kBelowOne);
  return touch_[k];
}

LightTree::Choice LightTree::Groups::choose(const SurfacePoint& p, double& u, std::size_t& at) const {
  if (!(total_ > 0.0)) return {};
  const Receivers here{p.position_m, 0.0, p.normal, 0.0};
  double share = 0.0;
  const std::uint32_t group = groupOf(here, u, at, share);
  if (group == kNone) return {};
  const Node* n = &tree_.nodes_[group];
  while (n->child != kNone) {
    const glm::dvec3 to = n->centre_m - p.position_m;
    if (n->alike && n->radius_m * n->radius_m < kCompact * kCompact * glm::dot(to, to)) {
      const std::span<const double> before(tree_.before_.data() + n->first, n->count + 1);
      const double strength = before.back() - before[0], drawn = before[0] + u * strength;
      // Of even lights, the one that u points at.
      auto k = std::min(std::size_t(u * n->count), std::size_t(n->count) - 1);
      if (!(before[k] <= drawn && drawn < before[k + 1])) k = std::min(partAt(before, drawn), std::size_t(n->count) - 1);
      const double own = before[k + 1] - before[k];
      u = std::clamp((drawn - before[k]) / own, 0.0, kBelowOne);
      return {tree_.lights_[n->first + k], share * own / strength};
    }
    const Node *left = &tree_.nodes_[n->child], *right = left + 1;
    const double a = bound(*left, here).most, b = bound(*right, here).most;
    if (!(a + b > 0.0)) return {};
    const double toLeft = a / (a + b);
    if (u < toLeft) {
      u /= toLeft;
      share *= toLeft;
      n = left;
    } else {
      u = (u - toLeft) / (1.0 - toLeft);
      share *= 1.0 - toLeft;
      n = right;
    }
    u = std::min(u, kBelowOne);
  }
  return {tree_.lights_[n->first], share};
}

}  // namespace lmc
