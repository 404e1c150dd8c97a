#include "libradiosity/solve_stored.h"

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

constexpr std::uint32_t kRaysAtOnce = 64;
constexpr double kByPower = 0.5;       // of the rays
constexpr double kMostRays = 65536.0;  // of one patch

/// N_ij rays of i met j, of R_i. Both A_i N_ij/R_i and A_j N_ji/R_j estimate the exchange area; weights inverse to their variances, which
/// go with A_i/R_i and A_j/R_j, make it (N_ij + N_ji)/(R_i/A_i + R_j/A_j) (the balance heuristic).
class Hits {
 public:
  /// `rays`: of each patch, in the tree's order.
  Hits(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const ClusterTree& tree, Surfaces& s,
       const std::vector<std::uint32_t>& rays, std::uint32_t stream, const Run& run)
      : start_(tree.order.size() + 1, 0), first_(tree.order.size() + 1, 0), density_(tree.order.size(), 0.0) {
    const std::size_t n = tree.order.size();
    std::vector<std::uint32_t> placeOf(n);
    for (std::size_t k = 0; k < n; ++k) {
      placeOf[tree.order[k]] = std::uint32_t(k);
      start_[k + 1] = start_[k] + rays[k];
      if (s.area[k] > 0.0) density_[k] = double(rays[k]) / s.area[k];
    }
    met_.assign(std::size_t(start_[n]), kNone);
    parallelFor(run, n, 16, [&](std::size_t k) {
      if (rays[k] == 0) return;
      const std::uint32_t id = tree.order[k];
      const Patch& patch = mesh.patches[id];
      const Sobol4 numbers = sequence(run.seed, Draw::Links, 1, 0, id, 0, stream);
      const Sobol4 places = sequence(run.seed, Draw::PatchDirect, 0, 0, id, 0, 0);
      std::array<Ray, kRaysAtOnce> batch;
      std::array<Hit, kRaysAtOnce> hits;
      std::uint32_t fronts = 0, backs = 0;
      for (std::uint32_t begin = 0; begin < rays[k]; begin += kRaysAtOnce) {
        const std::uint32_t count = std::min(kRaysAtOnce, rays[k] - begin);
        for (std::uint32_t r = 0; r < count; ++r) {
          batch[r] = exposedRay(scene, tracer, mesh, patch, numbers.point(begin + r), places);
        }
        tracer.closest({batch.data(), count}, {hits.data(), count}, Purpose::Shoot);
        for (std::uint32_t r = 0; r < count; ++r) {
          if (!hits[r]) continue;
          const std::uint32_t to = mesh.patchAt(hits[r].triangle, hits[r].bary, hits[r].front);
          ++(to == kNone ? backs : fronts);
          if (to != kNone && mesh.patches[to].area_m2 > 0.0) met_[start_[k] + begin + r] = placeOf[to];
        }
      }
      s.closure[k] = double(fronts) / rays[k];
      s.backs[k] = double(backs) / rays[k];
    });
    // The same hits by whom they met, in the order of those who cast them.
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
    std::vector<V> scaled(n);
    for (std::size_t i = 0; i < n; ++i) scaled[i] = s.scale[i] * b[i];
    power.resize(n);
    Run quiet = run;
    quiet.onProgress = {};
    parallelFor(quiet, n, 64, [&](std::size_t i) {
      V sum(0.0);
      const auto add = [&](std::uint32_t j) { sum += scaled[j] / (density_[i] + density_[j]); };
      for (std::uint64_t h = start_[i]; h < start_[i + 1]; ++h)
        if (met_[h] != kNone) add(met_[h]);
      for (std::uint64_t h = first_[i]; h < first_[i + 1]; ++h) add(from_[h]);
      power[i] = s.scale[i] * sum;
    });
  }

  std::uint64_t bytes() const { return 4 * (met_.size() + from_.size()) + 8 * (first_.size() + start_.size() + density_.size()); }

 private:
  std::vector<std::uint64_t> start_;  // of a patch in met_
  std::vector<std::uint32_t> met_;    // whom its rays met; kNone = no front
  std::vector<std::uint64_t> first_;  // of a patch in from_
  std::vector<std::uint32_t> from_;   // who met it
  std::vector<double> density_;       // rays per area [1/m^2]
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
  const Hits hits(scene, tracer, mesh, tree, surfaces, shareOut(surfaces, system, options.rays), options.stream, run);
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

StoredSolution solveStored(const Scene& scene, const Tracer& tracer, const PatchMesh& mesh, const PatchLight& light,
                           const StoredOptions& options, const Run& run) {
  return grey(mesh, light) ? solveAs<double>(scene, tracer, mesh, light, options, run)
                           : solveAs<glm::dvec3>(scene, tracer, mesh, light, options, run);
}

}  // namespace lmc
