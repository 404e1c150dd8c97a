#include "libradiosity/solve_links.h"

#include <algorithm>
#include <cmath>

#include "libradiosity/conjugate_gradients.h"
#include "libradiosity/visibility.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"
#include "libscene/sampling.h"
#include "libscene/texels.h"

namespace lmc {

namespace {

constexpr double kLinkShare = 0.5;           // of the goal, for what links leave wrong on a patch (hemisphere rays average over many)
constexpr double kDimmest = 0.02;            // of the level's mean illuminance: what is darker may be relatively worse
constexpr std::uint32_t kClosureRays = 64;   // of a patch where the level is open
constexpr std::size_t kClosurePatches = 16;  // a part of so many is closed when all their rays meet fronts: 256 of them
constexpr int kMostRounds = 12;
constexpr double kFirstThreshold = 1.0 / 16.0;  // of the sum of squared errors aimed at, for one link of the first round

/// A value and its first moments about the centroid, over the radius.
template <class V>
struct Moments {
  V mean{0.0}, x{0.0}, y{0.0}, z{0.0};
};

/// y = T b: pull means and moments up, links across, push down. Symmetric: patch i gets A_i sum over links of its ancestors
/// g/(A_a A_b) r(x_i) sum_k c(x_k) A_k b_k, r and c the link's linear functions about the centroids.
class Transport {
 public:
  Transport(const ClusterTree& tree, const std::vector<Link>& links) : tree_(tree), first_(tree.nodes.size() + 1, 0) {
    for (const Link& l : links) ++first_[l.a + 1], ++first_[l.b + 1];
    for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
    ends_.resize(std::size_t(first_.back()));
    std::vector<std::uint64_t> at(first_.begin(), first_.end() - 1);
    for (const Link& l : links) {
      const auto g = float(l.transfer_m2());
      ends_[at[l.a]++] = {l.b, g, l.slopeA, l.slopeB};
      ends_[at[l.b]++] = {l.a, g, l.slopeB, l.slopeA};
    }
  }

  /// Power that each patch receives from exitances b, both scaled by d.
  template <class V>
  void apply(const Surfaces& s, const std::vector<V>& b, std::vector<V>& power, const Run& run) const {
    const auto& nodes = tree_.nodes;
    std::vector<Moments<V>> from(nodes.size()), to(nodes.size());
    for (std::size_t i = nodes.size(); i-- > 0;) {
      const Cluster& c = nodes[i];
      Moments<V>& m = from[i];
      if (!(c.area_m2 > 0.0)) continue;
      if (c.isLeaf()) {
        m.mean = s.scale[c.first] * b[c.first];
        continue;
      }
      for (const std::uint32_t id : {c.child, c.child + 1}) {
        const Cluster& k = nodes[id];
        const double share = k.area_m2 / c.area_m2, size = double(k.radius_m) / double(c.radius_m);
        const glm::dvec3 off = (glm::dvec3(k.centroid_m) - glm::dvec3(c.centroid_m)) / double(c.radius_m);
        const Moments<V>& f = from[id];
        m.mean += share * f.mean;
        m.x += share * (size * f.x + off.x * f.mean);
        m.y += share * (size * f.y + off.y * f.mean);
        m.z += share * (size * f.z + off.z * f.mean);
      }
    }
    const Run quiet = run.quiet();
    parallelFor(quiet, nodes.size(), 256, [&](std::size_t i) {
      Moments<V> sum;
      if (!(nodes[i].area_m2 > 0.0)) return;
      for (std::uint64_t k = first_[i]; k < first_[i + 1]; ++k) {
        const End& e = ends_[k];
        const Moments<V>& f = from[e.other];
        const V p = double(e.exchange_m2) *
                    (f.mean + (double(e.slopeThere[0]) * f.x + double(e.slopeThere[1]) * f.y + double(e.slopeThere[2]) * f.z) / kUnits);
        sum.mean += p;
        sum.x += double(e.slopeHere[0]) * p;
        sum.y += double(e.slopeHere[1]) * p;
        sum.z += double(e.slopeHere[2]) * p;
      }
      const double A = nodes[i].area_m2, slope = 1.0 / (A * kUnits);
      to[i] = {sum.mean / A, slope * sum.x, slope * sum.y, slope * sum.z};
    });
    power.resize(s.area.size());
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      const Cluster& c = nodes[i];
      if (c.parent != kNone) {
        const Cluster& p = nodes[c.parent];
        const Moments<V>& f = to[c.parent];
        const double size = double(c.radius_m) / double(p.radius_m);
        const glm::dvec3 off = (glm::dvec3(c.centroid_m) - glm::dvec3(p.centroid_m)) / double(p.radius_m);
        to[i].mean += f.mean + off.x * f.x + off.y * f.y + off.z * f.z;
        to[i].x += size * f.x;
        to[i].y += size * f.y;
        to[i].z += size * f.z;
      }
      if (c.isLeaf()) power[c.first] = s.area[c.first] * s.scale[c.first] * to[i].mean;
    }
  }

  std::uint64_t bytes() const { return ends_.size() * sizeof(End) + first_.size() * sizeof first_[0]; }

 private:
  static constexpr double kUnits = double(kSlopeUnits);
  struct End {
    std::uint32_t other;
    float exchange_m2;
    std::array<std::int8_t, 3> slopeHere, slopeThere;
  };
  const ClusterTree& tree_;
  std::vector<std::uint64_t> first_;  // of a node in ends_
  std::vector<End> ends_;
};

/// What of each patch's light meets fronts, by the rays of exposePatches; in parts of the level where one of them did not, by
/// kClosureRays a patch. In a closed room every ray meets a front, and the share is exactly 1 at no further cost.
void findClosure(Surfaces& s, const ClusterTree& tree, const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const Run& run) {
  std::vector<std::uint32_t> lost(tree.nodes.size(), 0);
  for (std::size_t i = tree.nodes.size(); i-- > 0;) {
    const Cluster& c = tree.nodes[i];
    const Patch& p = mesh.patches[tree.order[c.first]];
    lost[i] = c.isLeaf() ? std::uint32_t(p.backs) + p.left : lost[c.child] + lost[c.child + 1];
  }
  s.closure.assign(s.area.size(), 1.0);
  s.backs.assign(s.area.size(), 0.0);
  std::vector<std::uint32_t> open;
  for (const std::uint32_t part : parts(tree, kClosurePatches))
    if (lost[part] > 0)
      for (std::uint32_t k = 0; k < tree.nodes[part].count; ++k) open.push_back(tree.nodes[part].first + k);
  const Run quiet = run.quiet();
  parallelFor(quiet, open.size(), 16, [&](std::size_t n) {
    const std::uint32_t k = open[n], id = tree.order[k];
    const Patch& patch = mesh.patches[id];
    if (!(patch.area_m2 > 0.0)) return;
    const Sobol4 numbers = sequence(run.seed, Draw::Closure, 0, 0, id, 0, 0),
                 places = sequence(run.seed, Draw::PatchDirect, 0, 0, id, 0, 0);
    std::array<Ray, kClosureRays> rays;
    std::array<Hit, kClosureRays> hits;
    for (std::uint32_t r = 0; r < kClosureRays; ++r) {
      rays[r] = exposedRay(scene, tracer, mesh, patch, numbers.point(r), places);
    }
    tracer.closest(rays, hits, Purpose::Visibility);
    std::uint32_t fronts = 0, backs = 0;
    for (const Hit& h : hits)
      if (h) ++(mesh.patchAt(h.triangle, h.bary, h.front) != kNone ? fronts : backs);
    s.closure[k] = double(fronts) / kClosureRays;
    s.backs[k] = double(backs) / kClosureRays;
  });
}

/// Everything that one level of links gives, with one channel or three.
template <class V>
class Solver {
 public:
  Solver(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const PatchLight& light, const HierarchicalOptions& options,
         const Run& run)
      : scene_(scene),
        tracer_(tracer),
        mesh_(mesh),
        options_(options),
        run_(run),
        tree_(makeClusters(scene, mesh, run)),
        links_(scene, mesh, tree_, tracer, options.partition, options.maxLinks, run) {
    system_ = systemOf<V>(tree_, mesh, light, surfaces_);
    for (std::size_t k = 0; k < tree_.order.size(); ++k) {
      area_ += surfaces_.area[k];
      mostRho_ = std::max(mostRho_, surfaces_.area[k] > 0.0 ? largest(system_.rho[k]) : 0.0);
      brightest_ = std::max(brightest_, largest(system_.direct[k]));
    }
  }

  HierarchicalSolution solve() {
    HierarchicalSolution out;
    out.fine.illuminance.assign(mesh_.patches.size(), Rgb(0.0f));
    out.coarse = out.fine.illuminance;
    if (!(brightest_ > 0.0) || !(area_ > 0.0)) {
      out.fine.stop = Stop::Nothing;
      return out;
    }
    const std::size_t n = tree_.order.size();
    // Before the first round: each patch shows its direct light and what a room of the level's mean would add.
    double rhoMean = 0.0, sent = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      rhoMean += surfaces_.area[i] * largest(system_.rho[i]) / area_;
      sent += surfaces_.area[i] * largest(system_.rho[i] * system_.direct[i]) / area_;
    }
    Answer<V> answer;
    findClosure(surfaces_, tree_, scene_, tracer_, mesh_, run_);
    answer.exitance.resize(n);
    answer.illuminance.assign(n, V(sent / std::max(0.05, 1.0 - rhoMean)));
    for (std::size_t i = 0; i < n; ++i) answer.exitance[i] = system_.rho[i] * (system_.direct[i] + answer.illuminance[i]);

    const double aim = kLinkShare * kLinkShare * options_.goal * options_.goal * area_;
    double threshold = kFirstThreshold * aim;
    std::vector<V> guess;
    for (int round = 0;; ++round) {
      double error = links_.refine(nodeLight(answer), threshold);
      bool full = false;
      while (error < 0.0) {
        full = true;
        threshold *= 2.0;
        error = links_.refine(nodeLight(answer), threshold);
      }
      full_ = full_ || full;
      const bool last = (round > 0 && (error <= aim || full)) || round + 1 >= kMostRounds;
      const Transport transport(tree_, links_.links());
      out.closureError = closeRows(surfaces_, transport, last ? std::min(1e-4, 0.01 * (1.0 - mostRho_)) : 1e-3, run_);
      if (last) out.coarse = bouncedOf(tree_, answer);
      answer = conjugateGradients(tree_, surfaces_, transport, system_, guess, last ? options_.maxTail : std::max(0.02, options_.maxTail),
                                  options_.maxIterations, run_);
      guess = answer.exitance;
      out.stats = links_.stats();
      out.stats.bytes += transport.bytes();
      out.stats.predictedError = std::sqrt(error / area_);
      run_.progress(std::min(1.0, std::log(aim / 100.0 / std::max(error, aim / 100.0)) / std::log(1e-4)));
      if (last) break;
      // The sum of squared errors falls about as the root of the threshold (twice the links, half their errors each).
      const double ratio = aim / std::max(error, 1e-300);
      threshold *= std::clamp(ratio * ratio, 1.0 / 81.0, 1.0 / 9.0);
    }
    out.fine.illuminance = bouncedOf(tree_, answer);
    out.fine.passes = answer.iterations;
    out.fine.stop = answer.converged ? Stop::Energy : Stop::Passes;
    out.fine.tail = answer.tail;
    out.fine.tailEstimate = answer.tailEstimate;
    out.stats.linksFull = full_;
    out.fine.energy = energyOf(surfaces_, system_, answer);
    double squares = 0.0, mean = 0.0;
    for (std::size_t k = 0; k < n; ++k) {
      const double A = surfaces_.area[k];
      const std::size_t i = tree_.order[k];
      const double d = largest(glm::abs(glm::dvec3(out.fine.illuminance[i]) - glm::dvec3(out.coarse[i])));
      squares += A * d * d;
      mean += A * largest(system_.direct[k] + answer.illuminance[k]);
    }
    out.linkError = mean > 0.0 ? std::sqrt(squares / area_) / (mean / area_) : 0.0;
    return out;
  }

 private:
  std::vector<NodeLight> nodeLight(const Answer<V>& answer) const {
    const auto& nodes = tree_.nodes;
    struct Sums {
      double B = 0.0, B2 = 0.0, E = 0.0, rho = 0.0;
    };
    std::vector<Sums> sum(nodes.size());
    for (std::size_t i = nodes.size(); i-- > 0;) {
      const Cluster& c = nodes[i];
      if (c.isLeaf()) {
        const double A = surfaces_.area[c.first], B = largest(answer.exitance[c.first]);
        sum[i] = {A * B, A * B * B, A * largest(system_.direct[c.first] + answer.illuminance[c.first]), 0.0};
      } else {
        const Sums &a = sum[c.child], &b = sum[c.child + 1];
        sum[i] = {a.B + b.B, a.B2 + b.B2, a.E + b.E, 0.0};
      }
    }
    const double meanE = sum[0].E / area_;
    std::vector<NodeLight> out(nodes.size());
    const auto most = std::uint32_t(std::max<std::size_t>(1, tree_.order.size() / kParts));
    std::vector<double> localE(nodes.size());
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      const Cluster& c = nodes[i];
      const double A = std::max(c.area_m2, 1e-300), B = sum[i].B / A;
      out[i].exitance = float(B);
      out[i].spread = float(std::sqrt(std::max(0.0, sum[i].B2 / A - B * B)));
      const bool part = c.parent == kNone || nodes[c.parent].count > most;  // a part of the level, or larger
      out[i].around = part ? float(B) : out[c.parent].around;
      localE[i] = part ? sum[i].E / A : localE[c.parent];
    }
    // What 1 lx wrong does to the light seen: rho times it leaves, against the light there.
    for (std::size_t i = nodes.size(); i-- > 0;) {
      const Cluster& c = nodes[i];
      if (c.isLeaf()) {
        const double rho = largest(system_.rho[c.first]), E = std::max(localE[i], kDimmest * meanE);
        sum[i].rho = surfaces_.area[c.first] * rho * rho / (E * E);
      } else {
        sum[i].rho = sum[c.child].rho + sum[c.child + 1].rho;
      }
      out[i].weight = c.area_m2 > 0.0 ? float(sum[i].rho / c.area_m2) : 0.0f;
    }
    return out;
  }

  const Scene& scene_;
  const Tracer& tracer_;
  const PatchMesh& mesh_;
  const HierarchicalOptions& options_;
  const Run& run_;
  ClusterTree tree_;
  LinkSet links_;
  Surfaces surfaces_;
  System<V> system_;
  double area_ = 0.0, mostRho_ = 0.0, brightest_ = 0.0;
  bool full_ = false;
};

}  // namespace

HierarchicalSolution solveHierarchical(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const PatchLight& light,
                                       const HierarchicalOptions& options, const Run& run) {
  if (grey(mesh, light)) return Solver<double>(scene, tracer, mesh, light, options, run).solve();
  return Solver<glm::dvec3>(scene, tracer, mesh, light, options, run).solve();
}

}  // namespace lmc
