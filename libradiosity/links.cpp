#include "libradiosity/links.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <limits>

#include "libradiosity/solve.h"
#include "libradiosity/visibility.h"
#include "libscene/constants.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"
#include "libscene/texels.h"

namespace lmc {

namespace {

constexpr double kQuadrature = 2.0;     // distance of centres over sum of radii from which 4 x 4 places are right to about 1 %
constexpr int kMostRays = 64;           // of one link
constexpr double kRayNoiseShare = 0.5;  // of the threshold, for the noise of the rays
constexpr double kMixed = 0.5;          // a shadow's edge in a link: what of its error V(1-V) says
constexpr double kRange = 1e-3;         // of the threshold's root: light that is not followed
constexpr float kDarkFloor = 0.1f;      // a dark source counts as this share of what is around the receiver: closure needs its factor, too

// What a question costs, in rays; from links_bench. Only these decide whether a rule pays: a clock must not change bytes.
constexpr std::array<double, kRules> kCostInRays{0.05, 0.02, 0.02, 3.0, 0.6};
constexpr double kRaysOfBlockedPair = 16.0;  // with those of its parts, which are not looked at any more
constexpr std::uint64_t kProbe = 1000;

}  // namespace

struct LinkSet::Pair {
  Link link;         // as it is when `old`, else with a and b alone
  bool old = false;  // measured in an earlier round
};

struct LinkSet::Outcome {
  enum class What : std::uint8_t { Drop, Keep, CutA, CutB, CutSelf } what = What::Drop;
  std::uint8_t asked = 0, settled = 0;  // a bit a rule
  std::uint32_t raysSaved = 0;
  std::uint32_t rays = 0;
  Link link;
  double error = 0.0;    // squared, that cutting could mend
  double dropped = 0.0;  // power bound
};

LinkSet::LinkSet(const Scene& scene, const PatchMesh& mesh, const ClusterTree& tree, const Tracer& tracer, const PartitionOptions& options,
                 std::uint64_t maxLinks, const Run& run)
    : scene_(scene),
      mesh_(mesh),
      tree_(tree),
      tracer_(tracer),
      partition_(scene, mesh, tree, tracer, run),
      options_(options),
      maxLinks_(std::max<std::uint64_t>(maxLinks, 1)),
      run_(run) {
  for (std::size_t r = 0; r < kRules; ++r) stats_.rules[r].on = options.on[r];
}

/// Unoccluded exchange and its variation over places of both sides.
void LinkSet::measure(Link& link) const {
  const Cluster &a = tree_.nodes[link.a], &b = tree_.nodes[link.b];
  std::array<double, kPlaces> rowA{}, rowB{};
  // Disc form between quarters: never above what a quarter's hemisphere holds.
  const float disc = float((a.area_m2 + b.area_m2) / (2.0 * double(kPlaces)));
  for (std::size_t i = 0; i < kPlaces; ++i) {
    const Place& p = tree_.places[a.place[i]];
    for (std::size_t j = 0; j < kPlaces; ++j) {
      const Place& q = tree_.places[b.place[j]];
      const glm::vec3 r = q.position_m - p.position_m;
      const float d2 = glm::dot(r, r), c1 = glm::dot(r, p.normal), c2 = -glm::dot(r, q.normal);
      if (!(c1 > 0.0f) || !(c2 > 0.0f)) continue;
      const double k = double(c1 * c2 / (d2 * (float(kPi) * d2 + disc)));
      rowA[i] += k;
      rowB[j] += k;
    }
  }
  double mean = 0.0;
  for (const double r : rowA) mean += r / double(kPlaces);
  const auto spread = [&](const std::array<double, kPlaces>& row) {
    double sum = 0.0;
    for (const double r : row) sum += (r - mean) * (r - mean);
    return mean > 0.0 ? std::sqrt(sum / double(kPlaces - 1)) / mean : 1.0;
  };
  const auto stored = [](double s) { return std::uint16_t(std::min(65535.0, s * double(kSpreadUnits))); };
  link.spreadA = a.isLeaf() ? 0 : stored(spread(rowA));
  link.spreadB = b.isLeaf() ? 0 : stored(spread(rowB));
  link.exchange_m2 = float(a.area_m2 * b.area_m2 * mean / double(kPlaces));
  const double distance = glm::distance(glm::dvec3(a.centre_m), glm::dvec3(b.centre_m)), size = double(a.radius_m) + double(b.radius_m);
  if (a.isLeaf() && b.isLeaf()) {
    if (distance < kQuadrature * size) link.exchange_m2 = float(lmc::exchangeArea_m2(scene_, mesh_, tree_.patchOf(a), tree_.patchOf(b)));
    return;
  }
  if (!(mean > 0.0)) {
    // No two of the places see each other, but others may: a twentieth of the most that they could exchange, in doubt.
    const double d2 = std::max(distance * distance, size * size);
    link.exchange_m2 = float(0.05 * std::min(a.area_m2 * b.area_m2 / (kPi * d2), std::min(a.area_m2, b.area_m2)));
  }
  // Boxes that touch: places do not show how the kernel grows between them.
  bool touch = true;
  for (int k = 0; k < 3; ++k) touch = touch && a.lo_m[k] <= b.hi_m[k] && b.lo_m[k] <= a.hi_m[k];
  if (touch || distance < size) {
    if (!a.isLeaf()) link.spreadA = std::max(link.spreadA, stored(1.0));
    if (!b.isLeaf()) link.spreadB = std::max(link.spreadB, stored(1.0));
  }
}

void LinkSet::castRays(Link& link, int upTo) const {
  const Cluster &a = tree_.nodes[link.a], &b = tree_.nodes[link.b];
  const Sobol4 numbers = sequence(run_.seed, Draw::Links, 0, 0, link.a, link.b, 0);
  const auto end = [&](const Cluster& c, float x, float y) {
    const auto [k, rest] = tree_.pick(c, x);
    const std::uint32_t id = tree_.order[k];
    const Patch& patch = mesh_.patches[id];
    glm::vec2 u(rest, y);
    if (patch.exposed != 0xffff && patch.exposed != 0) {
      // From its exposed places alone: the rest has no area.
      int n = std::min(int(rest * float(std::popcount(patch.exposed))), std::popcount(patch.exposed) - 1);
      std::uint32_t bits = patch.exposed;
      while (n-- > 0) bits &= bits - 1;
      const glm::vec4 at = sequence(run_.seed, Draw::PatchDirect, 0, 0, id, 0, 0).point(std::uint32_t(std::countr_zero(bits)));
      u = {at.z, at.w};
    }
    const auto [triangle, bary] = mesh_.sample(patch, u);
    const auto c3 = scene_.corners_m(triangle);
    const glm::dvec3 e = c3[1] - c3[0], f = c3[2] - c3[0];
    const glm::dvec3 n = glm::normalize(glm::cross(e, f));
    return std::pair(c3[0] + bary.x * e + bary.y * f, patch.back ? -n : n);
  };
  std::array<Ray, kMostRays> rays;
  std::array<double, kMostRays> kernel;
  std::array<std::uint8_t, kMostRays> blocked;
  std::size_t n = 0;
  for (int k = link.samples; k < upTo; ++k) {
    const glm::vec4 u = numbers.point(std::uint32_t(k));
    const auto [p, np] = end(a, u.x, u.y);
    const auto [q, nq] = end(b, u.z, u.w);
    const glm::dvec3 r = q - p;
    const double d2 = glm::dot(r, r), K = std::max(0.0, glm::dot(r, np)) * std::max(0.0, -glm::dot(r, nq)) / (d2 * d2);
    if (!(K > 0.0)) continue;
    const glm::vec3 from = tracer_.lifted(p, np), to = tracer_.lifted(q, nq);
    rays[n] = {from, to - from, 1.0f};
    kernel[n++] = K;
  }
  if (n == 0) {
    link.samples = std::uint8_t(upTo);
    link.clear = std::uint8_t(upTo);
    return;
  }
  tracer_.occluded({rays.data(), n}, {blocked.data(), n}, Purpose::Visibility);
  double all = 0.0, clear = 0.0, seen = 0.0;
  for (std::size_t k = 0; k < n; ++k) {
    all += kernel[k];
    if (!blocked[k]) clear += kernel[k], seen += 1.0;
  }
  const double before = double(link.samples), now = double(upTo) - before, share = clear / all;
  link.visible = float((before * double(link.visible) + now * share) / (before + now));
  link.clear = std::uint8_t(std::min<double>(upTo, double(link.clear) + std::round(now * seen / double(n))));
  link.samples = std::uint8_t(upTo);
}

LinkSet::Outcome LinkSet::judge(const Pair& pair, const std::vector<NodeLight>& light, double threshold) const {
  using What = Outcome::What;
  Outcome out;
  out.link = pair.link;
  Link& link = out.link;
  const Cluster &a = tree_.nodes[link.a], &b = tree_.nodes[link.b];
  if (!(a.area_m2 > 0.0) || !(b.area_m2 > 0.0)) return out;
  if (link.a == link.b) {
    // A flat cluster does not see itself; the faces of one patch bend so little that they exchange nothing to speak of.
    if (!a.isLeaf() && !partition_.averted(a, b)) out.what = What::CutSelf;
    return out;
  }
  const auto ask = [&](Rule rule, auto&& question) {
    const auto r = std::size_t(rule);
    if (!stats_.rules[r].on) return false;
    out.asked = std::uint8_t(out.asked | 1u << r);
    // Timed for the report alone; nothing follows from it.
    const bool timed = ((link.a * 31u + link.b) & 63u) == 0;
    const auto start = timed ? std::chrono::steady_clock::now() : std::chrono::steady_clock::time_point();
    const bool yes = question();
    if (timed)
      nanoseconds_[r] += 64 * std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now() - start).count();
    if (yes) out.settled = std::uint8_t(out.settled | 1u << r);
    return yes;
  };
  const NodeLight &la = light[link.a], &lb = light[link.b];
  const float Ba = std::max(la.exitance, kDarkFloor * lb.around), Bb = std::max(lb.exitance, kDarkFloor * la.around);
  // Squared error for a relative error of 1 of the exchange: of the illuminance, over the area that it falls on.
  const double onA = double(la.weight) / a.area_m2, onB = double(lb.weight) / b.area_m2;
  const double sourceB = double(Bb) * double(Bb) * onA, sourceA = double(Ba) * double(Ba) * onB;

  if (!pair.old) {
    if (ask(Rule::Facing, [&] { return partition_.averted(a, b); })) return out;
    if (ask(Rule::Cells, [&] { return partition_.apart(link.a, link.b); })) return out;
    double most = 0.0;
    const auto outOfRange = [&] {
      double gap2 = 0.0;
      for (int k = 0; k < 3; ++k) {
        const double g = std::max({0.0, double(a.lo_m[k]) - double(b.hi_m[k]), double(b.lo_m[k]) - double(a.hi_m[k])});
        gap2 += g * g;
      }
      most = gap2 > 0.0 ? a.area_m2 * b.area_m2 / (kPi * gap2) : std::numeric_limits<double>::infinity();
      return most * most * (sourceA + sourceB) < kRange * kRange * threshold;
    };
    if (ask(Rule::Range, outOfRange)) {
      out.dropped = most * (double(Ba) + double(Bb));
      return out;
    }
    if (ask(Rule::Blocked, [&] { return partition_.blockedShaft(a, b); })) {
      out.raysSaved = std::uint32_t(kRaysOfBlockedPair);
      return out;
    }
    measure(link);
    if (!(link.exchange_m2 > 0.0f)) return out;  // two patches that do not see each other's fronts
  }
  const double g = double(link.exchange_m2), v = double(link.visible);
  const auto square = [](double x) { return x * x; };
  const double sa = double(link.spreadA) / double(kSpreadUnits), sb = double(link.spreadB) / double(kSpreadUnits);
  // Cutting a mends how the kernel varies over a as receiver, and over a as a source of uneven light.
  const double errorA = square(g * v * sa) * (sourceB + square(double(la.spread)) * onB);
  const double errorB = square(g * v * sb) * (sourceA + square(double(lb.spread)) * onA);
  const double whole = g * g * (sourceA + sourceB);
  const bool leaves = a.isLeaf() && b.isLeaf();
  if (!leaves && errorA + errorB > threshold) {
    out.what = (errorA >= errorB ? !a.isLeaf() : b.isLeaf()) ? What::CutA : What::CutB;
    return out;
  }
  if (pair.old && link.samples == 0) {
    out.error = errorA + errorB;
    out.what = What::Keep;
    return out;
  }
  // Rays: as many as keep the noise of their share, at most V(1 - V) = 1/4 each, below its part of the threshold.
  const int wanted = int(std::clamp(std::ceil(0.25 * whole / (kRayNoiseShare * threshold)), 1.0, double(kMostRays)));
  if (link.shaft == 0 && !pair.old && ask(Rule::Empty, [&] { return partition_.emptyShaft(a, b); })) link.shaft = 1;
  if (link.shaft != 0) {
    out.raysSaved = std::uint32_t(wanted);
    out.error = errorA + errorB;
    out.what = What::Keep;
    return out;
  }
  if (wanted > int(link.samples)) {
    out.rays = std::uint32_t(wanted - int(link.samples));
    castRays(link, wanted);
  }
  const double share = double(link.clear) / double(link.samples), mixed = share * (1.0 - share) * kMixed * kMixed * whole;
  const double scale = square(double(link.visible) / std::max(v, 1e-30));
  if (!leaves && (errorA + errorB) * std::min(1.0, scale) + mixed > threshold) {
    out.what = (a.isLeaf() || (!b.isLeaf() && b.radius_m > a.radius_m)) ? What::CutB : What::CutA;
    return out;
  }
  out.error =
      leaves
          ? 0.0
          : square(double(link.visible)) * square(g) *
                    (square(sa) * (sourceB + square(double(la.spread)) * onB) + square(sb) * (sourceA + square(double(lb.spread)) * onA)) +
                mixed;
  out.what = What::Keep;
  return out;
}

double LinkSet::refine(const std::vector<NodeLight>& light, double threshold) {
  std::vector<Pair> open;
  if (stats_.rounds == 0) {
    open.push_back({});
  } else {
    open.reserve(links_.size());
    for (const Link& l : links_) open.push_back({l, true});
  }
  std::vector<Link> kept;
  kept.reserve(links_.size());
  std::vector<Outcome> outcomes;
  std::vector<Pair> next;
  LinkStats stats = stats_;
  double error = 0.0, dropped = stats_.droppedShare;
  Run quiet = run_;
  quiet.onProgress = {};
  constexpr std::size_t kAtOnce = 1 << 16;
  while (!open.empty()) {
    next.clear();
    for (std::size_t begin = 0; begin < open.size(); begin += kAtOnce) {
      const std::size_t count = std::min(kAtOnce, open.size() - begin);
      outcomes.resize(count);
      parallelFor(quiet, count, 64, [&](std::size_t k) { outcomes[k] = judge(open[begin + k], light, threshold); });
      for (std::size_t k = 0; k < count; ++k) {  // in order
        const Outcome& o = outcomes[k];
        ++stats.pairs;
        stats.rays += o.rays;
        for (std::size_t r = 0; r < kRules; ++r) {
          stats.rules[r].asked += o.asked >> r & 1u;
          stats.rules[r].settled += o.settled >> r & 1u;
        }
        if ((o.settled >> unsigned(Rule::Blocked) & 1u) != 0) stats.rules[std::size_t(Rule::Blocked)].raysSaved += o.raysSaved;
        if (o.what == Outcome::What::Keep && o.link.shaft != 0) stats.rules[std::size_t(Rule::Empty)].raysSaved += o.raysSaved;
        dropped += o.dropped;
        Pair child;
        child.link.a = o.link.a;
        child.link.b = o.link.b;
        child.link.shaft = o.link.shaft;
        switch (o.what) {
          case Outcome::What::Drop:
            break;
          case Outcome::What::Keep:
            kept.push_back(o.link);
            error += o.error;
            break;
          case Outcome::What::CutA:
          case Outcome::What::CutB: {
            std::uint32_t& cut = o.what == Outcome::What::CutA ? child.link.a : child.link.b;
            const std::uint32_t c = tree_.nodes[cut].child;
            cut = c;
            next.push_back(child);
            cut = c + 1;
            next.push_back(child);
            break;
          }
          case Outcome::What::CutSelf: {
            const std::uint32_t c = tree_.nodes[o.link.a].child;
            for (const auto& [x, y] : {std::pair{c, c}, std::pair{c, c + 1}, std::pair{c + 1, c + 1}}) {
              child.link.a = x;
              child.link.b = y;
              next.push_back(child);
            }
            break;
          }
        }
      }
      // Every open pair may become a link; only what is kept counts, so that the limit is met by links and not by guesses.
      if (kept.size() > maxLinks_) return -1.0;
      if (options_.automatic)
        for (const Rule rule : {Rule::Empty, Rule::Blocked}) {
          const RuleCount& c = stats.rules[std::size_t(rule)];
          if (c.on && c.asked >= kProbe && double(c.raysSaved) < double(c.asked) * kCostInRays[std::size_t(rule)])
            stats.rules[std::size_t(rule)].on = stats_.rules[std::size_t(rule)].on = false;
        }
    }
    open.swap(next);
  }
  links_ = std::move(kept);
  for (std::size_t r = 0; r < kRules; ++r) {
    stats.rules[r].seconds = 1e-9 * double(nanoseconds_[r].load());
    stats.rules[r].on = stats_.rules[r].on;
  }
  stats.links = links_.size();
  stats.bytes = links_.size() * sizeof(Link);
  stats.threshold = threshold;
  stats.droppedShare = dropped;
  ++stats.rounds;
  stats_ = stats;
  return error;
}

}  // namespace lmc
