#include "libradiosity/solve_links.h"

#include <algorithm>
#include <cmath>

#include "libscene/parallel.h"

namespace lmc {

namespace {

constexpr double kLinkShare = 0.5;           // of the goal, for what links leave wrong on a patch (hemisphere rays average over many)
constexpr double kDimmest = 0.02;            // of the level's mean illuminance: what is darker may be relatively worse
constexpr std::size_t kParts = 64;           // the level is converged in each of about so many parts
constexpr double kDimmestPart = 1e-4;        // of the brightest one: darker ones are not waited for
constexpr std::uint32_t kClosureRays = 256;  // a part's openness is known from so many rays
constexpr int kScalings = 200;
constexpr int kMostRounds = 12;
constexpr double kFirstThreshold = 1.0 / 16.0;  // of the sum of squared errors aimed at, for one link of the first round

/// One number a channel, or one for all.
template <class V>
double largest(const V& v) {
  if constexpr (std::is_same_v<V, double>)
    return v;
  else
    return std::max({v.x, v.y, v.z});
}

/// Patches by their place in the tree's order.
struct Surfaces {
  std::vector<double> area, closure;  ///< [m^2], share of what leaves that meets fronts
  std::vector<double> scale;          ///< d_i of the symmetric scaling
};

/// y = T b: pull means up, links across, push down. Symmetric: power P_i = A_i sum over links of i's ancestors g/(A_a A_b) sum A_k b_k.
class Transport {
 public:
  Transport(const ClusterTree& tree, const std::vector<Link>& links) : tree_(tree), first_(tree.nodes.size() + 1, 0) {
    for (const Link& l : links) ++first_[l.a + 1], ++first_[l.b + 1];
    for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
    ends_.resize(std::size_t(first_.back()));
    std::vector<std::uint64_t> at(first_.begin(), first_.end() - 1);
    for (const Link& l : links) {
      const auto g = float(l.transfer_m2());
      ends_[at[l.a]++] = {l.b, g};
      ends_[at[l.b]++] = {l.a, g};
    }
  }

  /// Power that each patch receives from exitances b, both scaled by d.
  template <class V>
  void apply(const Surfaces& s, const std::vector<V>& b, std::vector<V>& power, const Run& run) const {
    const auto& nodes = tree_.nodes;
    static thread_local std::vector<V> mean, arrived;
    mean.assign(nodes.size(), V(0.0));
    arrived.assign(nodes.size(), V(0.0));
    for (std::size_t i = nodes.size(); i-- > 0;) {
      const Cluster& c = nodes[i];
      mean[i] = c.isLeaf() ? s.area[c.first] * s.scale[c.first] * b[c.first] : mean[c.child] + mean[c.child + 1];
    }
    for (std::size_t i = 0; i < nodes.size(); ++i)
      if (nodes[i].area_m2 > 0.0) mean[i] /= nodes[i].area_m2;
    const std::vector<V>& from = mean;  // of this thread: workers must not name their own
    std::vector<V>& to = arrived;
    Run quiet = run;
    quiet.onProgress = {};
    parallelFor(quiet, nodes.size(), 256, [&](std::size_t i) {
      V sum(0.0);
      for (std::uint64_t k = first_[i]; k < first_[i + 1]; ++k) sum += double(ends_[k].exchange_m2) * from[ends_[k].other];
      to[i] = nodes[i].area_m2 > 0.0 ? sum / nodes[i].area_m2 : V(0.0);
    });
    power.resize(s.area.size());
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      const Cluster& c = nodes[i];
      if (c.parent != kNone) arrived[i] += arrived[c.parent];
      if (c.isLeaf()) power[c.first] = s.area[c.first] * s.scale[c.first] * arrived[i];
    }
  }

  std::uint64_t bytes() const { return ends_.size() * sizeof(End) + first_.size() * sizeof first_[0]; }

 private:
  struct End {
    std::uint32_t other;
    float exchange_m2;
  };
  const ClusterTree& tree_;
  std::vector<std::uint64_t> first_;  // of a node in ends_
  std::vector<End> ends_;
};

/// What of each patch's light meets fronts. Row sums of links say how it varies, rays how much it is: pools of patches with kClosureRays
/// between them share one factor. In a closed room every ray meets a front, and the share is exactly 1.
void findClosure(Surfaces& s, const ClusterTree& tree, const PatchMesh& mesh, const std::vector<double>& rows) {
  std::vector<std::uint32_t> rays(tree.nodes.size());
  for (std::size_t i = tree.nodes.size(); i-- > 0;) {
    const Cluster& c = tree.nodes[i];
    if (c.isLeaf()) {
      const Patch& p = mesh.patches[tree.order[c.first]];
      rays[i] = std::uint32_t(p.fronts) + p.backs + p.left;
    } else {
      rays[i] = rays[c.child] + rays[c.child + 1];
    }
  }
  s.closure.assign(s.area.size(), 1.0);
  for (std::size_t i = 0; i < tree.nodes.size(); ++i) {
    const Cluster& c = tree.nodes[i];
    const bool pool = rays[i] < 2 * kClosureRays || c.isLeaf();
    if (!pool || (c.parent != kNone && rays[c.parent] < 2 * kClosureRays)) continue;
    std::uint32_t fronts = 0;
    double met = 0.0, linked = 0.0;
    for (std::uint32_t k = c.first; k < c.first + c.count; ++k) {
      const Patch& p = mesh.patches[tree.order[k]];
      const std::uint32_t n = std::uint32_t(p.fronts) + p.backs + p.left;
      fronts += p.fronts;
      met += n > 0 ? s.area[k] * double(p.fronts) / n : 0.0;
      linked += rows[k];
    }
    const double factor = linked > 0.0 ? met / linked : 0.0;
    for (std::uint32_t k = c.first; k < c.first + c.count; ++k) {
      if (!(s.area[k] > 0.0)) continue;
      s.closure[k] = fronts == rays[i] ? 1.0 : std::clamp(factor * rows[k] / s.area[k], 0.0, 1.0);
    }
  }
}

/// d_i sum_j T_ij d_j = A_i closure_i: rows become right and reciprocity stays.
double closeRows(Surfaces& s, const ClusterTree& tree, const Transport& transport, const PatchMesh& mesh, double tolerance,
                 const Run& run) {
  const std::size_t n = s.area.size();
  s.scale.assign(n, 1.0);
  std::vector<double> one(n, 1.0), row;
  transport.apply(s, one, row, run);
  findClosure(s, tree, mesh, row);
  double before = 0.0, area = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    before += std::abs(row[i] - s.area[i] * s.closure[i]);
    area += s.area[i];
  }
  for (int step = 0; step < kScalings; ++step) {
    double off = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const double wanted = s.area[i] * s.closure[i];
      if (!(row[i] > 0.0) || !(wanted > 0.0)) continue;
      const double ratio = wanted / row[i];
      off += s.area[i] * std::abs(ratio - 1.0);
      s.scale[i] *= std::sqrt(std::clamp(ratio, 0.25, 4.0));
    }
    if (off <= tolerance * area) break;
    transport.apply(s, one, row, run);
  }
  return before / std::max(area, 1e-300);
}

template <class V>
struct System {
  std::vector<V> rho, direct;  // reflectance, illuminance before any bounce
};

template <class V>
struct Answer {
  std::vector<V> exitance, illuminance;  // by bounces
  std::vector<V> residual;               // power that one more bounce would still change [lm]
  double tail = 0.0, tailEstimate = 0.0;
  int iterations = 0;
  bool converged = false;
};

/// B = rho (E + H), H_i A_i = sum_j T_ij B_j as (I - S) x = b, S = R^1/2 D R^1/2 (solve.h). Stops when each part of the level is converged:
/// a residual r in a room of reflectance rho makes an error of at most r/(1 - rho) there.
template <class V>
Answer<V> conjugateGradients(const ClusterTree& tree, const Surfaces& s, const Transport& transport, const System<V>& system,
                             const std::vector<V>& guess, double tolerance, int maxIterations, const Run& run) {
  const std::size_t n = s.area.size();
  const auto each = [](auto f, const V& a, const V& b) {
    if constexpr (std::is_same_v<V, double>)
      return f(a, b);
    else
      return V(f(a.x, b.x), f(a.y, b.y), f(a.z, b.z));
  };
  const auto root = [](const V& v) {
    if constexpr (std::is_same_v<V, double>)
      return std::sqrt(v);
    else
      return glm::sqrt(v);
  };
  const auto quotient = [&](const V& a, const V& b) { return each([](double x, double y) { return y > 0.0 ? x / y : 0.0; }, a, b); };
  std::vector<V> scaled(n), x(n), r(n), p(n), Ap(n), power, B(n);  // scaled_i = sqrt(rho_i/A_i)
  for (std::size_t i = 0; i < n; ++i) scaled[i] = s.area[i] > 0.0 ? root(system.rho[i] / s.area[i]) : V(0.0);
  const auto apply = [&](const std::vector<V>& v, std::vector<V>& out) {
    for (std::size_t i = 0; i < n; ++i) B[i] = scaled[i] * v[i];
    transport.apply(s, B, power, run);
    for (std::size_t i = 0; i < n; ++i) out[i] = v[i] - scaled[i] * power[i];
  };
  double rhoMost = 0.0, rhoMean = 0.0, area = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    rhoMost = std::max(rhoMost, s.area[i] > 0.0 ? largest(system.rho[i]) : 0.0);
    rhoMean += s.area[i] * largest(system.rho[i]);
    area += s.area[i];
    // x = B sqrt(A/rho)
    x[i] = quotient(guess.empty() ? system.rho[i] * system.direct[i] : guess[i], scaled[i]);
  }
  rhoMean /= std::max(area, 1e-300);
  apply(x, Ap);
  V rr(0.0);
  for (std::size_t i = 0; i < n; ++i) {
    r[i] = system.direct[i] * s.area[i] * scaled[i] - Ap[i];
    p[i] = r[i];
    rr += r[i] * r[i];
  }
  const std::vector<std::uint32_t> rooms = parts(tree, std::max<std::size_t>(1, n / kParts));
  Answer<V> out;
  const auto finished = [&] {
    std::vector<double> light(rooms.size()), wrong(rooms.size());
    double brightest = 0.0, left = 0.0, all = 0.0;
    for (std::size_t k = 0; k < rooms.size(); ++k) {
      const Cluster& c = tree.nodes[rooms[k]];
      double absorbed = 0.0;
      for (std::uint32_t i = c.first; i < c.first + c.count; ++i) {
        const V there = x[i] * scaled[i] * s.area[i], rest = r[i] * scaled[i] * s.area[i];
        light[k] += largest(there);
        wrong[k] += largest(each([](double a, double) { return std::abs(a); }, rest, rest));
        absorbed += s.area[i] * (1.0 - largest(system.rho[i]));
      }
      left += wrong[k];
      all += light[k];
      wrong[k] /= std::max(absorbed, 1e-6 * c.area_m2);
      light[k] /= std::max(c.area_m2, 1e-300);
      brightest = std::max(brightest, light[k]);
    }
    out.tail = all > 0.0 ? left / std::max(1e-6, 1.0 - rhoMost) / all : 0.0;
    out.tailEstimate = std::min(out.tail, all > 0.0 ? left / std::max(1e-6, 1.0 - rhoMean) / all : 0.0);
    if (out.tail > tolerance) return false;
    for (std::size_t k = 0; k < rooms.size(); ++k)
      if (light[k] > kDimmestPart * brightest && wrong[k] > tolerance * light[k]) return false;
    return true;
  };
  for (;; ++out.iterations) {
    out.converged = finished();
    if (out.converged || out.iterations >= maxIterations || !(largest(rr) > 0.0)) break;
    apply(p, Ap);
    V pAp(0.0);
    for (std::size_t i = 0; i < n; ++i) pAp += p[i] * Ap[i];
    const V alpha = quotient(rr, pAp);
    V next(0.0);
    for (std::size_t i = 0; i < n; ++i) {
      x[i] += alpha * p[i];
      r[i] -= alpha * Ap[i];
      next += r[i] * r[i];
    }
    const V beta = quotient(next, rr);
    for (std::size_t i = 0; i < n; ++i) p[i] = r[i] + beta * p[i];
    rr = next;
  }
  out.exitance.resize(n);
  out.residual.resize(n);
  for (std::size_t i = 0; i < n; ++i) out.exitance[i] = x[i] * scaled[i];
  transport.apply(s, out.exitance, power, run);
  out.illuminance.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    // Light is not negative; what CG overshoots is within its tolerance.
    out.illuminance[i] = s.area[i] > 0.0 ? each([](double a, double b) { return std::max(a, b); }, power[i] / s.area[i], V(0.0)) : V(0.0);
    out.residual[i] = s.area[i] * (system.rho[i] * (system.direct[i] + out.illuminance[i]) - out.exitance[i]);
  }
  return out;
}

/// Everything that one level of links gives, with one channel or three.
template <class V>
class Solver {
 public:
  Solver(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const PatchLight& light, const HierarchicalOptions& options,
         const Run& run)
      : scene_(scene),
        mesh_(mesh),
        options_(options),
        run_(run),
        tree_(makeClusters(scene, mesh, run)),
        links_(scene, mesh, tree_, tracer, options.partition, options.maxLinks, run) {
    const std::size_t n = tree_.order.size();
    surfaces_.area.resize(n);
    system_.rho.resize(n);
    system_.direct.resize(n);
    for (std::size_t k = 0; k < n; ++k) {
      const std::size_t i = tree_.order[k];
      const Patch& p = mesh.patches[i];
      surfaces_.area[k] = p.area_m2;
      area_ += p.area_m2;
      const glm::dvec3 rho(p.reflectance), E = glm::dvec3(light.direct[i]) + glm::dvec3(light.sky[i]);
      if constexpr (std::is_same_v<V, double>)
        system_.rho[k] = rho.x, system_.direct[k] = E.x;
      else
        system_.rho[k] = rho, system_.direct[k] = E;
      mostRho_ = std::max(mostRho_, p.area_m2 > 0.0 ? largest(system_.rho[k]) : 0.0);
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
      out.closureError = closeRows(surfaces_, tree_, transport, mesh_, last ? std::min(1e-4, 0.01 * (1.0 - mostRho_)) : 1e-3, run_);
      if (last) out.coarse = bounced(answer);
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
    out.fine.illuminance = bounced(answer);
    out.fine.passes = answer.iterations;
    out.fine.stop = answer.converged ? Stop::Energy : Stop::Passes;
    out.fine.tail = answer.tail;
    out.fine.tailEstimate = answer.tailEstimate;
    out.stats.linksFull = full_;
    double exitance = 0.0, squares = 0.0, mean = 0.0;
    for (std::size_t k = 0; k < n; ++k) {
      const Patch& p = mesh_.patches[tree_.order[k]];
      const double A = surfaces_.area[k], rays = double(p.backs) + p.left;
      const glm::dvec3 one(1.0), rho = one * system_.rho[k], H = one * answer.illuminance[k], B = one * answer.exitance[k],
                                 E = one * system_.direct[k];
      out.fine.energy.sent += A * rho * E;
      out.fine.energy.absorbed += A * (one - rho) * H;
      const glm::dvec3 lost = A * (1.0 - surfaces_.closure[k]) * B;
      const double backs = rays > 0.0 ? double(p.backs) / rays : 0.0;
      out.fine.energy.backs += backs * lost;
      out.fine.energy.left += (1.0 - backs) * lost;
      out.fine.energy.unsent -= one * answer.residual[k];
      exitance += A * largest(answer.exitance[k]);
      const std::size_t i = tree_.order[k];
      const double d = largest(glm::abs(glm::dvec3(out.fine.illuminance[i]) - glm::dvec3(out.coarse[i])));
      squares += A * d * d;
      mean += A * largest(system_.direct[k] + answer.illuminance[k]);
    }
    out.stats.droppedShare /= std::max(exitance, 1e-300);
    out.linkError = mean > 0.0 ? std::sqrt(squares / area_) / (mean / area_) : 0.0;
    return out;
  }

 private:
  Bounced bounced(const Answer<V>& answer) const {
    Bounced out(mesh_.patches.size(), Rgb(0.0f));
    for (std::size_t k = 0; k < answer.illuminance.size(); ++k) out[tree_.order[k]] = Rgb(glm::dvec3(1.0) * answer.illuminance[k]);
    return out;
  }

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

bool grey(const PatchMesh& mesh, const PatchLight& light) {
  const auto is = [](const Rgb& c) { return c.r == c.g && c.g == c.b; };
  for (std::size_t i = 0; i < mesh.patches.size(); ++i)
    if (!is(mesh.patches[i].reflectance) || !is(light.direct[i]) || !is(light.sky[i])) return false;
  return true;
}

}  // namespace

HierarchicalSolution solveHierarchical(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const PatchLight& light,
                                       const HierarchicalOptions& options, const Run& run) {
  if (grey(mesh, light)) return Solver<double>(scene, tracer, mesh, light, options, run).solve();
  return Solver<glm::dvec3>(scene, tracer, mesh, light, options, run).solve();
}

}  // namespace lmc
