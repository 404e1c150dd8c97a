#include "libradiosity/solve_stored.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "libradiosity/conjugate_gradients.h"
#include "libradiosity/visibility.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"
#include "libscene/sampling.h"
#include "libscene/texels.h"

namespace lmc {

namespace {

constexpr std::uint32_t kRaysAtOnce = 64;
constexpr double kRaysAtTwoPercent = 32.0, kLeastRays = 65536.0;  // of a patch; of all together
constexpr double kByPower = 0.5;                                  // of the rays
constexpr double kMostRays = 65536.0;                             // of one patch

/// N_ij rays of i met j, of R_i. Both A_i N_ij/R_i and A_j N_ji/R_j estimate the exchange area; weights inverse to their variances, which
/// go with A_i/R_i and A_j/R_j, make it (N_ij + N_ji)/(R_i/A_i + R_j/A_j) (the balance heuristic).
/// Sums run over whom a patch met, in the order of its rays, and then over who met it, in the order of those: the same bits whether hits
/// are kept both ways, one way, or not at all.
class Hits {
 public:
  /// `rays`: of each patch, in the tree's order.
  Hits(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const ClusterTree& tree, Surfaces& s,
       const std::vector<std::uint32_t>& rays, const StoredOptions& options, const Run& run)
      : scene_(scene),
        tracer_(tracer),
        mesh_(mesh),
        tree_(tree),
        stream_(options.stream),
        placeOf_(tree.order.size()),
        start_(tree.order.size() + 1, 0),
        density_(tree.order.size(), 0.0) {
    const std::size_t n = tree.order.size();
    for (std::size_t k = 0; k < n; ++k) {
      placeOf_[tree.order[k]] = std::uint32_t(k);
      start_[k + 1] = start_[k] + rays[k];
      if (s.area[k] > 0.0) density_[k] = double(rays[k]) / s.area[k];
    }
    kept_ = 4 * start_[n] <= options.maxBytes;
    if (kept_) met_.resize(std::size_t(start_[n]));
    parallelFor(run, n, 16, [&](std::size_t k) {
      if (rays[k] == 0) return;
      std::vector<std::uint32_t> own;
      const Met met = cast(k, kept_ ? std::span(met_).subspan(std::size_t(start_[k]), rays[k]) : resized(own, rays[k]), run.seed);
      s.closure[k] = double(met.fronts) / rays[k];
      s.backs[k] = double(met.backs) / rays[k];
    });
    if (!kept_ || 8 * start_[n] > options.maxBytes) return;
    // The same hits by whom they met, in the order of those who cast them.
    first_.assign(n + 1, 0);
    for (const std::uint32_t j : met_)
      if (j != kNone) ++first_[j + 1];
    for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
    from_.resize(std::size_t(first_.back()));
    std::vector<std::uint64_t> at(first_.begin(), first_.end() - 1);
    for (std::size_t k = 0; k < n; ++k)
      for (std::uint64_t h = start_[k]; h < start_[k + 1]; ++h)
        if (met_[h] != kNone) from_[at[met_[h]]++] = std::uint32_t(k);
  }

  template <class V>
  void apply(const Surfaces& s, const std::vector<V>& b, std::vector<V>& power, const Run& run) const {
    const std::size_t n = s.area.size();
    struct Sender {  // both in one place of memory: hits are all over it
      V scaled;
      double density;
    };
    std::vector<Sender> senders(n);
    for (std::size_t i = 0; i < n; ++i) senders[i] = {s.scale[i] * b[i], density_[i]};
    power.assign(n, V(0.0));
    const Run quiet = run.quiet();
    const auto given = [&](std::size_t i, std::size_t j) { return senders[j].scaled / (density_[i] + senders[j].density); };
    parallelFor(quiet, n, 64, [&](std::size_t i) {
      std::vector<std::uint32_t> own;
      V sum(0.0);
      for (const std::uint32_t j : metBy(i, own, quiet.seed))
        if (j != kNone) sum += given(i, j);
      if (!first_.empty())
        for (std::uint64_t h = first_[i]; h < first_[i + 1]; ++h) sum += given(i, from_[h]);
      power[i] = sum;
    });
    if (first_.empty()) addFrom(given, power, quiet);
    for (std::size_t i = 0; i < n; ++i) power[i] = s.scale[i] * power[i];
  }

  std::uint64_t bytes() const { return 4 * (met_.size() + from_.size()) + 8 * (first_.size() + start_.size() + density_.size()); }

 private:
  struct Met {
    std::uint32_t fronts = 0, backs = 0;
  };
  static std::span<std::uint32_t> resized(std::vector<std::uint32_t>& v, std::size_t n) {
    v.resize(n);
    return v;
  }

  /// Casts the rays of a patch: whom each of them met.
  Met cast(std::size_t k, std::span<std::uint32_t> met, std::uint64_t seed) const {
    const std::uint32_t id = tree_.order[k];
    const Patch& patch = mesh_.patches[id];
    const Sobol4 numbers = sequence(seed, Draw::Links, 1, 0, id, 0, stream_);
    const Sobol4 places = sequence(seed, Draw::PatchDirect, 0, 0, id, 0, 0);
    std::array<Ray, kRaysAtOnce> batch;
    std::array<Hit, kRaysAtOnce> hits;
    Met count;
    for (std::uint32_t begin = 0; begin < met.size(); begin += kRaysAtOnce) {
      const std::uint32_t rays = std::min(kRaysAtOnce, std::uint32_t(met.size()) - begin);
      for (std::uint32_t r = 0; r < rays; ++r) batch[r] = exposedRay(scene_, tracer_, mesh_, patch, numbers.point(begin + r), places);
      tracer_.closest({batch.data(), rays}, {hits.data(), rays}, Purpose::Shoot);
      const std::span<std::uint32_t> own = met.subspan(begin, rays);
      mesh_.patchesAt({hits.data(), rays}, own);
      for (std::uint32_t r = 0; r < rays; ++r) {
        if (!hits[r]) continue;
        ++(own[r] == kNone ? count.backs : count.fronts);
        if (own[r] != kNone) own[r] = mesh_.patches[own[r]].area_m2 > 0.0 ? placeOf_[own[r]] : kNone;
      }
    }
    return count;
  }
  std::span<const std::uint32_t> metBy(std::size_t k, std::vector<std::uint32_t>& own, std::uint64_t seed) const {
    const auto rays = std::size_t(start_[k + 1] - start_[k]);
    if (kept_) return std::span(met_).subspan(std::size_t(start_[k]), rays);
    if (rays > 0) cast(k, resized(own, rays), seed);
    return own;
  }

  /// What each patch is given by those who met it, without a list of them: one patch after the other hands out what its hits say.
  template <class Given, class V>
  void addFrom(const Given& given, std::vector<V>& power, const Run& run) const {
    std::vector<std::vector<std::uint32_t>> own(kAtOnce);
    for (std::size_t begin = 0; begin < power.size(); begin += kAtOnce) {
      const std::size_t count = std::min(kAtOnce, power.size() - begin);
      if (!kept_) {
        parallelFor(run, count, 16, [&](std::size_t k) {
          own[k].clear();
          metBy(begin + k, own[k], run.seed);
        });
      }
      for (std::size_t k = begin; k < begin + count; ++k)
        for (const std::uint32_t i : kept_ ? metBy(k, own[0], run.seed) : std::span<const std::uint32_t>(own[k - begin]))
          if (i != kNone) power[i] += given(i, k);
    }
  }

  static constexpr std::size_t kAtOnce = 1024;
  const Scene& scene_;
  const Tracer& tracer_;
  const PatchMesh& mesh_;
  const ClusterTree& tree_;
  std::uint32_t stream_;
  bool kept_ = true;
  std::vector<std::uint32_t> placeOf_;  // of a patch in the tree's order
  std::vector<std::uint64_t> start_;    // of a patch in met_
  std::vector<std::uint32_t> met_;      // whom its rays met; kNone = no front; empty = not kept
  std::vector<std::uint64_t> first_;    // of a patch in from_; empty = not kept
  std::vector<std::uint32_t> from_;     // who met it
  std::vector<double> density_;         // rays per area [1/m^2]
};

/// Half of the rays to all patches alike, half by the power that they send first: what is bright is worth knowing the ways of.
template <class V>
std::vector<std::uint32_t> shareOut(const Surfaces& s, const System<V>& system, std::uint32_t each) {
  const std::size_t n = s.area.size();
  double power = 0.0;
  std::size_t with = 0;
  for (std::size_t k = 0; k < n; ++k) {
    power += s.area[k] * largest(system.rho[k] * system.direct[k]);
    with += s.area[k] > 0.0;
  }
  std::vector<std::uint32_t> out(n, 0);
  for (std::size_t k = 0; k < n; ++k) {
    if (!(s.area[k] > 0.0)) continue;
    const double share = power > 0.0 ? s.area[k] * largest(system.rho[k] * system.direct[k]) / power * double(with) : 1.0;
    out[k] = std::uint32_t(std::clamp(std::ceil(double(each) * (1.0 - kByPower + kByPower * share)), 1.0, double(kMostRays)));
  }
  return out;
}

template <class V>
StoredSolution solveAs(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const PatchLight& light,
                       const StoredOptions& options, const Run& run) {
  const ClusterTree tree = makeClusters(scene, mesh, run);
  Surfaces surfaces;
  const System<V> system = systemOf<V>(tree, mesh, light, surfaces);
  StoredSolution out;
  out.solution.illuminance.assign(mesh.patches.size(), Rgb(0.0f));
  double brightest = 0.0, mostRho = 0.0;
  for (std::size_t k = 0; k < surfaces.area.size(); ++k)
    if (surfaces.area[k] > 0.0) {
      brightest = std::max(brightest, largest(system.direct[k]));
      mostRho = std::max(mostRho, largest(system.rho[k]));
    }
  if (!(brightest > 0.0)) return out;
  const Hits hits(scene, tracer, mesh, tree, surfaces, shareOut(surfaces, system, options.rays), options, run);
  out.bytes = hits.bytes();
  out.closureError = closeRows(surfaces, hits, std::min(1e-4, 0.01 * (1.0 - mostRho)), run);
  const Answer<V> answer = conjugateGradients(tree, surfaces, hits, system, {}, options.maxTail, options.maxIterations, run);
  out.solution.illuminance = bouncedOf(tree, answer);
  out.solution.energy = energyOf(surfaces, system, answer);
  out.solution.passes = answer.iterations;
  out.solution.stop = answer.converged ? Stop::Energy : Stop::Passes;
  out.solution.tail = answer.tail;
  out.solution.tailEstimate = answer.tailEstimate;
  return out;
}

}  // namespace

std::uint32_t storedRaysFor(double goal, std::size_t patches) {
  return std::uint32_t(std::ceil(std::max(kRaysAtTwoPercent * 0.02 / goal, kLeastRays / double(std::max<std::size_t>(1, patches)))));
}

StoredSolution solveStored(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const PatchLight& light,
                           const StoredOptions& options, const Run& run) {
  return grey(mesh, light) ? solveAs<double>(scene, tracer, mesh, light, options, run)
                           : solveAs<glm::dvec3>(scene, tracer, mesh, light, options, run);
}

}  // namespace lmc
