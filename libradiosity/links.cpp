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
constexpr std::uint32_t kHorizonPairs = 64;
constexpr double kMixed = 0.5;      // a shadow's edge in a link: what of its error V(1-V) says
constexpr double kCurvature = 1.0;  // of the slope's square: four places cannot show how the kernel bends
constexpr float kFlat = 0.9f;       // cosine of a normal cone's half angle: in wider ones some patches face the other side and some do not
constexpr double kTouching = 0.2;   // form factor of squares that meet at a right angle
constexpr float kMostSlope = 0.9f;  // so that no place of the cluster gets less than nothing
constexpr float kDarkFloor = 0.1f;  // a dark source counts as this share of what is around the receiver: closure needs its factor, too

// What a question costs, in rays; from links_bench. Only these decide whether a rule pays: a clock must not change bytes.
constexpr std::array<double, kRules> kCostInRays{0.05, 0.02, 3.0, 0.6};
constexpr double kRaysOfBlockedPair = 16.0;  // with those of its parts, which are not looked at any more
constexpr double kProbeRays = 3000.0;  // what a rule may cost before it is judged: the first pairs are whole rooms, which nothing settles

// Relative errors in a byte, by their logarithm: 2^-7 to 2^9.
std::uint8_t storedError(double e) { return std::uint8_t(std::clamp(std::lround((std::log2(std::max(e, 1e-9)) + 7.0) * 16.0), 0l, 255l)); }
double errorOf(std::uint8_t stored) {
  static const auto table = [] {
    std::array<double, 256> t{};
    for (std::size_t i = 0; i < t.size(); ++i) t[i] = i == 0 ? 0.0 : std::exp2(double(i) / 16.0 - 7.0);
    return t;
  }();
  return table[stored];
}

bool tooNear(const Cluster& a, const Cluster& b) {
  return glm::distance(a.centre_m, b.centre_m) < float(kQuadrature) * (a.radius_m + b.radius_m);
}

}  // namespace

struct LinkSet::Ends {
  glm::dvec3 from, fromNormal, to, toNormal;
  double kernel = 0.0;
};

struct LinkSet::Pair {
  Link link;           // as it is when `old`, else with a and b alone
  bool old = false;    // measured in an earlier round
  bool empty = false;  // nothing stands between
};

struct LinkSet::Outcome {
  enum class What : std::uint8_t { Drop, Keep, CutA, CutB, CutSelf } what = What::Drop;
  std::uint8_t asked = 0, settled = 0;  // a bit a rule
  bool empty = false;
  std::uint32_t raysSaved = 0;
  std::uint32_t rays = 0;
  Link link;
  double error = 0.0;  // squared, that cutting could mend
};

LinkSet::LinkSet(const Scene& scene, const PatchMesh& mesh, const ClusterTree& tree, const Tracer& tracer, const PartitionOptions& options,
                 std::uint64_t maxLinks, const Run& run)
    : scene_(scene),
      mesh_(mesh),
      tree_(tree),
      tracer_(tracer),
      partition_(scene, mesh, tree, tracer, options, run),
      options_(options),
      maxLinks_(std::max<std::uint64_t>(maxLinks, 1)),
      run_(run) {
  for (std::size_t r = 0; r < kRules; ++r) stats_.rules[r].on = options.on[r];
  if (!partition_.hasRooms()) stats_.rules[std::size_t(Rule::Cells)].on = false;  // nothing to ask
}

/// Unoccluded exchange, its slopes and what they leave, from the kernel between 4 x 4 places.
void LinkSet::measure(Link& link, bool& horizon) const {
  const Cluster &a = tree_.nodes[link.a], &b = tree_.nodes[link.b];
  const auto &placesA = tree_.places[link.a], &placesB = tree_.places[link.b];
  std::array<double, kPlaces> rowA{}, rowB{};
  const auto areaA = float(a.area_m2), areaB = float(b.area_m2);
  double mean = 0.0;
  for (std::size_t i = 0; i < kPlaces; ++i) {
    const Place& p = placesA[i];
    for (std::size_t j = 0; j < kPlaces; ++j) {
      const Place& q = placesB[j];
      const glm::vec3 r = q.position_m - p.position_m;
      const float d2 = glm::dot(r, r), c1 = glm::dot(r, p.normal), c2 = -glm::dot(r, q.normal);
      if (!(c1 > 0.0f) || !(c2 > 0.0f)) {
        horizon = horizon || (p.share > 0.0f && q.share > 0.0f);
        continue;
      }
      // Disc form between parts: never above what a part's hemisphere holds.
      const double k = double(c1 * c2 / (d2 * (float(kPi) * d2 + 0.5f * (areaA * p.share + areaB * q.share))));
      rowA[i] += double(q.share) * k;
      rowB[j] += double(p.share) * k;
      mean += double(p.share) * double(q.share) * k;
    }
  }
  link.exchange_m2 = float(a.area_m2 * b.area_m2 * mean);
  const double distance = glm::distance(glm::dvec3(a.centre_m), glm::dvec3(b.centre_m)), size = double(a.radius_m) + double(b.radius_m);
  if (a.isLeaf() && b.isLeaf()) {
    if (distance >= kQuadrature * size) return;
    double g = lmc::exchangeArea_m2(scene_, mesh_, tree_.patchOf(a), tree_.patchOf(b));
    // The buried part of a patch lies behind what buries it: where that is the other patch, the form factor has left it out already.
    if (distance < size)
      for (const Cluster* c : {&a, &b})
        if (const std::uint16_t e = mesh_.patches[tree_.patchOf(*c)].exposed; e != 0xffff) g *= 16.0 / std::popcount(e);
    link.exchange_m2 = float(std::min(g, 0.7 * std::min(a.area_m2, b.area_m2)));
    return;
  }
  // Boxes that touch: places do not show how the kernel grows between them.
  bool touch = true;
  for (int k = 0; k < 3; ++k) touch = touch && a.lo_m[k] <= b.hi_m[k] && b.lo_m[k] <= a.hi_m[k];
  touch = touch || distance < size;
  if (!(mean > 0.0)) {
    // No two of the places see each other, but others may: a twentieth of the most that they could exchange, in doubt.
    const double d2 = std::max(distance * distance, size * size);
    link.exchange_m2 = float(0.05 * std::min(a.area_m2 * b.area_m2 / (kPi * d2), std::min(a.area_m2, b.area_m2)));
  }
  // There, and where faces look every way, the error is what they could exchange and not what they seem to.
  const double most = kTouching * std::min(a.area_m2, b.area_m2) / std::max(1e-300, double(link.exchange_m2));
  const auto fit = [&](const Cluster& c, const std::array<Place, kPlaces>& places, const std::array<double, kPlaces>& row,
                       std::array<std::int8_t, 3>& slope, std::uint8_t& error) {
    if (c.isLeaf()) return;
    const double bound = touch ? std::max(1.0, most) : c.cosine < kFlat ? 1.0 : 0.0;
    if (!(mean > 0.0)) {
      error = storedError(std::max(1.0, bound));
      return;
    }
    glm::vec3 g(0.0f);
    for (std::size_t i = 0; i < kPlaces; ++i) g += float(row[i] / mean - 1.0) * places[i].slope;
    if (const float l = glm::length(g); l > kMostSlope) g *= kMostSlope / l;
    for (int k = 0; k < 3; ++k) slope[std::size_t(k)] = std::int8_t(std::lround(g[k] * kSlopeUnits));
    double linear = 0.0, rest = 0.0;
    for (std::size_t i = 0; i < kPlaces; ++i) {
      const double along = double(glm::dot(g, places[i].position_m - c.centroid_m)) / double(c.radius_m);
      linear += double(places[i].share) * along * along;
      rest += double(places[i].share) * (row[i] / mean - 1.0 - along) * (row[i] / mean - 1.0 - along);
    }
    error = storedError(std::max(std::sqrt(rest + kCurvature * kCurvature * linear * linear), bound));
  };
  fit(a, placesA, rowA, link.slopeA, link.errorA);
  fit(b, placesB, rowB, link.slopeB, link.errorB);
}

/// Places and normals of one pair of a link's sequence.
LinkSet::Ends LinkSet::ends(const Link& link, const Sobol4& numbers, std::uint32_t index) const {
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
  const glm::vec4 u = numbers.point(index);
  Ends out;
  std::tie(out.from, out.fromNormal) = end(tree_.nodes[link.a], u.x, u.y);
  std::tie(out.to, out.toNormal) = end(tree_.nodes[link.b], u.z, u.w);
  const glm::dvec3 r = out.to - out.from;
  const double d2 = glm::dot(r, r);
  out.kernel = std::max(0.0, glm::dot(r, out.fromNormal)) * std::max(0.0, -glm::dot(r, out.toNormal)) / (d2 * d2);
  return out;
}

/// Of two clusters that see each other in part only: 16 fixed places say little about where the horizon is.
double LinkSet::exchangeByPairs(const Link& link) const {
  const Cluster &a = tree_.nodes[link.a], &b = tree_.nodes[link.b];
  const Sobol4 numbers = sequence(run_.seed, Draw::Links, 0, 0, link.a, link.b, 1);
  double sum = 0.0;
  for (std::uint32_t k = 0; k < kHorizonPairs; ++k) sum += ends(link, numbers, k).kernel / kHorizonPairs;
  return std::min(a.area_m2 * b.area_m2 * sum / kPi, std::min(a.area_m2, b.area_m2));
}

void LinkSet::castRays(Link& link, int upTo) const {
  const Sobol4 numbers = sequence(run_.seed, Draw::Links, 0, 0, link.a, link.b, 0);
  std::array<Ray, kMostRays> rays;
  std::array<double, kMostRays> kernel;
  std::array<std::uint8_t, kMostRays> blocked;
  std::size_t n = 0;
  for (int k = link.samples; k < upTo; ++k) {
    const Ends e = ends(link, numbers, std::uint32_t(k));
    if (!(e.kernel > 0.0)) continue;
    const glm::vec3 from = tracer_.lifted(e.from, e.fromNormal), to = tracer_.lifted(e.to, e.toNormal);
    rays[n] = {from, to - from, 1.0f};
    kernel[n++] = e.kernel;
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
  link.visible = std::uint16_t(std::lround(65535.0 * (before * link.share() + now * share) / (before + now)));
  link.clear = std::uint8_t(std::min<double>(upTo, double(link.clear) + std::round(now * seen / double(n))));
  link.samples = std::uint8_t(upTo);
}

LinkSet::Outcome LinkSet::judge(const Pair& pair, const std::vector<NodeLight>& light, double threshold) const {
  using What = Outcome::What;
  Outcome out;
  out.empty = pair.empty;
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

  bool horizon = false;  // parts of one are behind the other
  if (!pair.old) {
    if (ask(Rule::Facing, [&] { return partition_.averted(a, b); })) return out;
    if (ask(Rule::Cells, [&] { return partition_.apart(link.a, link.b); })) {
      out.raysSaved = std::uint32_t(kRaysOfBlockedPair);
      return out;
    }
    if (ask(Rule::Blocked, [&] { return partition_.blockedShaft(a, b); })) {
      out.raysSaved = std::uint32_t(kRaysOfBlockedPair);
      return out;
    }
    measure(link, horizon);
    if (!(link.exchange_m2 > 0.0f)) return out;  // two patches that do not see each other's fronts
  }
  const double g = double(link.exchange_m2),
               v = link.samples == 0 ? 1.0 : (double(link.clear) + 1.0) / (double(link.samples) + 2.0);  // few blocked rays are no proof
  const auto square = [](double x) { return x * x; };
  const double sa = errorOf(link.errorA), sb = errorOf(link.errorB);
  // Cutting a mends how the kernel varies over a as receiver, and over a as a source of uneven light.
  const double errorA = square(g * v * sa) * (sourceB + square(double(la.spread)) * onB);
  const double errorB = square(g * v * sb) * (sourceA + square(double(lb.spread)) * onA);
  const double whole = g * g * (sourceA + sourceB);
  const bool leaves = a.isLeaf() && b.isLeaf();
  if (!leaves && errorA + errorB > threshold) {
    out.what = (errorA >= errorB ? !a.isLeaf() : b.isLeaf()) ? What::CutA : What::CutB;
    return out;
  }
  if (horizon && !(leaves && tooNear(a, b))) {
    link.exchange_m2 = float(exchangeByPairs(link));
    link.slopeA = link.slopeB = {};
    if (!(link.exchange_m2 > 0.0f)) link.exchange_m2 = 1e-30f;  // it may still be cut in a later round
  }
  if (pair.old && link.samples == 0) {
    out.error = errorA + errorB;
    out.what = What::Keep;
    return out;
  }
  // Rays: as many as keep the noise of their share, at most V(1 - V) = 1/4 each, below its part of the threshold.
  const int wanted = int(std::clamp(std::ceil(0.25 * whole / (kRayNoiseShare * threshold)), 1.0, double(kMostRays)));
  if (!pair.empty && !pair.old && ask(Rule::Empty, [&] { return partition_.emptyShaft(a, b); })) out.empty = true;
  if (out.empty) {
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
  const double scale = square((double(link.clear) + 1.0) / (double(link.samples) + 2.0) / v);
  if (!leaves && (errorA + errorB) * std::min(1.0, scale) + mixed > threshold) {
    out.what = (a.isLeaf() || (!b.isLeaf() && b.radius_m > a.radius_m)) ? What::CutB : What::CutA;
    return out;
  }
  out.error =
      leaves
          ? 0.0
          : square(link.share()) * square(g) *
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
    for (const Link& l : links_) open.push_back({l, true, l.samples == 0 && l.visible == 0xffff});
  }
  std::vector<Link> kept;
  kept.reserve(links_.size());
  std::vector<Outcome> outcomes;
  std::vector<Pair> next;
  LinkStats stats = stats_;
  double error = 0.0;
  const Run quiet = run_.quiet();
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
        for (const Rule rule : {Rule::Cells, Rule::Blocked})
          if ((o.settled >> unsigned(rule) & 1u) != 0) stats.rules[std::size_t(rule)].raysSaved += o.raysSaved;
        if (o.what == Outcome::What::Keep && o.empty) stats.rules[std::size_t(Rule::Empty)].raysSaved += o.raysSaved;
        Pair child;
        child.link.a = o.link.a;
        child.link.b = o.link.b;
        child.empty = o.empty;
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
        for (const Rule rule : {Rule::Cells, Rule::Empty, Rule::Blocked}) {
          const RuleCount& c = stats.rules[std::size_t(rule)];
          const double cost = double(c.asked) * kCostInRays[std::size_t(rule)];
          if (c.on && cost >= kProbeRays && double(c.raysSaved) < cost)
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
  ++stats.rounds;
  stats_ = stats;
  return error;
}

}  // namespace lmc
