#include "libradiosity/light_tree.h"

#include <algorithm>
#include <cmath>
#include <queue>
#include <span>

#include "libradiosity/lights.h"
#include "libscene/constants.h"

namespace lmc {

namespace {

constexpr std::size_t kFewLights = 24;  // are all asked by themselves
constexpr double kSmallRest = 0.03;     // groups may hold so much of what all might give
constexpr std::uint32_t kSummed = 4;    // lights of a node whose estimates are added up for the node's own
constexpr double kByStrength = 0.05;
constexpr double kHemisphere = kPi / 2.0;

double angleBetween(const glm::dvec3& a, const glm::dvec3& b) { return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b)); }

}  // namespace

void LightTree::Node::measure() {
  centre_m = 0.5 * (lo + hi);
  radius_m = 0.5 * glm::length(hi - lo);
  spread = Angle::of(spread_rad);
  cover = spread + Angle::of(cone_rad);
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
  std::vector<Node> leaves;
  for (std::uint32_t i = 0; i < scene.lights.size(); ++i) {
    const Light& l = scene.lights[i];
    if (l.kind == Light::Kind::Directional || l.classic) {
      always_.push_back(i);
      continue;
    }
    Node n;
    n.lo = n.hi = l.position_m;
    n.axis = l.direction;
    n.cone_rad = l.kind == Light::Kind::Spot ? std::acos(std::clamp(l.cosOuter, -1.0, 1.0)) : kPi;
    n.strength = double(strength(l.intensity));
    n.range_m = l.range_m;
    n.light = i;
    n.count = 1;
    n.measure();
    if (n.strength > 0.0) leaves.push_back(n);
  }
  for (std::uint32_t e = 0; e < emitters.whole.size(); ++e) {
    const Emitter& emitter = emitters.whole[e];
    Node n;
    for (const glm::dvec3& c : emitter.corner_m) {
      n.lo = glm::min(n.lo, c);
      n.hi = glm::max(n.hi, c);
    }
    n.axis = emitter.normal;
    n.cone_rad = kHemisphere;
    n.flat = true;
    n.strength = emitter.area_m2 * double(strength(emitter.radiance));
    n.light = punctualCount_ + e;
    n.count = 1;
    n.measure();
    if (n.strength > 0.0) leaves.push_back(n);
  }
  if (leaves.empty()) return;
  nodes_.reserve(2 * leaves.size());
  build(leaves, 0, leaves.size());
}

std::uint32_t LightTree::build(std::vector<Node>& leaves, std::size_t begin, std::size_t end) {
  if (end - begin == 1) {
    nodes_.push_back(leaves[begin]);
    return std::uint32_t(nodes_.size() - 1);
  }
  // Halved at the median of the middles along the longest side.
  glm::dvec3 lo(1e300), hi(-1e300);
  for (std::size_t i = begin; i < end; ++i) {
    const glm::dvec3 c = 0.5 * (leaves[i].lo + leaves[i].hi);
    lo = glm::min(lo, c);
    hi = glm::max(hi, c);
  }
  const glm::dvec3 size = hi - lo;
  const int side = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const std::size_t middle = begin + (end - begin) / 2;
  std::stable_sort(leaves.begin() + std::ptrdiff_t(begin), leaves.begin() + std::ptrdiff_t(end),
                   [side](const Node& a, const Node& b) { return a.lo[side] + a.hi[side] < b.lo[side] + b.hi[side]; });
  const std::uint32_t left = build(leaves, begin, middle), right = build(leaves, middle, end);
  Node n;
  // Children lie side by side.
  n.child = std::uint32_t(nodes_.size());
  nodes_.push_back(nodes_[left]);
  nodes_.push_back(nodes_[right]);
  const Node &a = nodes_[n.child], &b = nodes_[n.child + 1];
  n.lo = glm::min(a.lo, b.lo);
  n.hi = glm::max(a.hi, b.hi);
  n.strength = a.strength + b.strength;
  n.range_m = a.range_m > 0.0 && b.range_m > 0.0 ? std::max(a.range_m, b.range_m) : 0.0;
  n.cone_rad = std::max(a.cone_rad, b.cone_rad);
  n.flat = a.flat && b.flat;
  n.count = a.count + b.count;
  const glm::dvec3 axis = a.strength * a.axis + b.strength * b.axis;
  const double length = glm::length(axis);
  n.axis = length > 1e-12 * n.strength ? axis / length : a.axis;
  n.spread_rad = std::min(kPi, std::max(angleBetween(n.axis, a.axis) + a.spread_rad, angleBetween(n.axis, b.axis) + b.spread_rad));
  n.measure();
  nodes_.push_back(n);
  return std::uint32_t(nodes_.size() - 1);
}

double LightTree::bound(const Node& n, const Receivers& r) const {
  const glm::dvec3 to = n.centre_m - r.centre_m;
  const double reach = n.radius_m + r.radius_m, distance = glm::length(to);
  if (n.range_m > 0.0 && distance - reach > n.range_m) return 0.0;
  const double cosines = mostCosines(n, to, distance, reach, r.normal, Angle::of(std::min(r.bend_rad, kPi)));
  // A flat emitter nearer than its own size fills the view at most: its distance is never below that.
  const double least = std::max(distance - reach, 0.0);
  return n.strength * cosines / std::max({least * least, n.radius_m * n.radius_m, 1e-6 * distance * distance, 1e-12});
}

double LightTree::estimate(const Node& n, const SurfacePoint& p) const {
  const glm::dvec3 to = n.centre_m - p.position_m;
  const double distance2 = glm::dot(to, to), distance = std::sqrt(distance2);
  if (n.range_m > 0.0 && distance - n.radius_m > n.range_m) return 0.0;
  return n.strength * mostCosines(n, to, distance, n.radius_m, p.normal, {}) / std::max({distance2, n.radius_m * n.radius_m, 1e-12});
}

LightCut LightTree::cutFor(const Receivers& r) const {
  LightCut cut;
  cut.punctual = always_;
  const auto take = [&](const Node& n) {
    if (n.light < punctualCount_)
      cut.punctual.push_back(n.light);
    else
      cut.emitters.push_back(n.light - punctualCount_);
  };
  if (nodes_.empty()) return cut;
  const bool few = nodes_.back().count <= kFewLights;
  using Entry = std::pair<double, std::uint32_t>;
  const auto less = [](const Entry& a, const Entry& b) { return a.first != b.first ? a.first < b.first : a.second > b.second; };
  std::priority_queue<Entry, std::vector<Entry>, decltype(less)> open(less);
  double inGroups = 0.0, sure = 0.0;
  std::size_t nodes = 0;
  const auto add = [&](std::uint32_t id) {
    const double b = bound(nodes_[id], r);
    if (b <= 0.0) return;
    ++nodes;
    if (nodes_[id].child == kNone) {
      take(nodes_[id]);
      sure += b;
      return;
    }
    open.emplace(b, id);
    inGroups += b;
  };
  add(std::uint32_t(nodes_.size() - 1));
  while (!open.empty() && (few || (nodes < kMostNodes && inGroups > kSmallRest * (inGroups + sure)))) {
    const auto [b, id] = open.top();
    open.pop();
    inGroups -= b;
    --nodes;
    add(nodes_[id].child);
    add(nodes_[id].child + 1);
  }
  while (!open.empty()) {
    cut.groups.push_back(open.top().second);
    open.pop();
  }
  std::ranges::sort(cut.punctual);
  std::ranges::sort(cut.emitters);
  return cut;
}

double LightTree::sumOfFew(std::uint32_t id, const SurfacePoint& p) const {
  const Node& n = nodes_[id];
  return n.count > kSummed || n.child == kNone ? estimate(n, p) : sumOfFew(n.child, p) + sumOfFew(n.child + 1, p);
}

LightTree::Groups::Groups(const LightTree& tree, const LightCut& cut, const SurfacePoint& p) : tree_(tree), cut_(cut) {
  double given = 0.0, strengths = 0.0;
  for (std::size_t g = 0; g < cut.groups.size(); ++g) {
    const Node& n = tree.nodes_[cut.groups[g]];
    begin_[g] = tree.estimate(n, p);
    given += begin_[g];
    strengths += n.strength;
  }
  for (std::size_t g = 0; g < cut.groups.size(); ++g) {
    const double byGiven = given > 0.0 ? begin_[g] / given : 0.0, byStrength = tree.nodes_[cut.groups[g]].strength / strengths;
    begin_[g] = total_;
    total_ += (1.0 - kByStrength) * byGiven + kByStrength * byStrength;
  }
}

LightTree::Choice LightTree::Groups::choose(const SurfacePoint& p, double& u) const {
  if (!(total_ > 0.0)) return {};
  const std::span<const double> begins(begin_.data(), cut_.groups.size());
  const double pick = u * total_;
  const std::size_t g = std::size_t(std::ranges::upper_bound(begins, pick) - begins.begin()) - 1;
  const double part = (g + 1 < begins.size() ? begins[g + 1] : total_) - begins[g];
  double share = part / total_;
  u = std::min((pick - begins[g]) / part, 1.0 - 1e-9);
  std::uint32_t id = cut_.groups[g];
  const auto& nodes_ = tree_.nodes_;
  while (nodes_[id].child != kNone) {
    const std::uint32_t child = nodes_[id].child;
    const double a = tree_.sumOfFew(child, p), b = tree_.sumOfFew(child + 1, p);
    if (!(a + b > 0.0)) return {};
    const double left = a / (a + b);
    if (u < left) {
      u /= left;
      share *= left;
      id = child;
    } else {
      u = (u - left) / (1.0 - left);
      share *= 1.0 - left;
      id = child + 1;
    }
    u = std::min(u, 1.0 - 1e-9);
  }
  return {nodes_[id].light, share};
}

}  // namespace lmc
