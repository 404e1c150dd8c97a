#include "lmc/verify_pipeline.h"

#include <algorithm>
#include <cmath>

namespace lmc {

namespace {

constexpr std::size_t kLeastSeeds = 6, kMostSeeds = 12;
constexpr std::size_t kMostPatches = 1500;  // of a dense solution
constexpr double kFloat = 6e-8;             // half an ulp
constexpr double kRoundings = 16;  // between an emission and a texel: corners, radiance, factors, two halves of the map and their mean

double meanOf(const std::vector<Baked>& bakes, std::size_t count, const std::function<double(const Baked&)>& of, double* variance) {
  double mean = 0.0, squares = 0.0;
  for (std::size_t k = 0; k < count; ++k) mean += of(bakes[k]) / double(count);
  for (std::size_t k = 0; k < count; ++k) squares += std::pow(of(bakes[k]) - mean, 2);
  if (variance) *variance = squares / (double(count) * double(count - 1));
  return mean;
}

}  // namespace

Bakes::Bakes(Scene scene, BakeSceneOptions options, const VerifyContext& context)
    : scene_(std::move(scene)), options_(std::move(options)), context_(context) {
  // A rounding of the albedo moves the light by as much as the bounces add up to.
  for (const Material& m : scene_.materials)
    for (int c = 0; c < 3; ++c) conditioning_ = std::max(conditioning_, 1.0 / std::max(1e-6, 1.0 - double(m.baseColor[c])));
}

const std::vector<Baked>& Bakes::level(std::size_t refinement, std::size_t seeds) {
  if (levels_.size() <= refinement) levels_.resize(refinement + 1);
  std::vector<Baked>& bakes = levels_[refinement];
  while (bakes.size() < seeds) {
    BakeSceneOptions o = options_;
    o.threads = context_.threads;
    o.seed = combine(context_.seed, bakes.size() + 1);
    o.side = options_.side << refinement;
    o.patchSize_m = options_.patchSize_m / double(1 << refinement);
    o.solver = Solver::Dense;
    o.interpolate = false;  // its error is a stated share of a map's goal; a mean over an object is judged closer than that
    bakes.push_back(bakeScene(scene_, o));
  }
  return bakes;
}

Got Bakes::value(double standardError, const std::function<double(const Baked&)>& of) {
  std::size_t fine = 1, seeds = kLeastSeeds;
  Got got;
  got.way = Way::Sampled;
  for (;;) {
    double varianceFine = 0.0, varianceCoarse = 0.0;
    const double coarse = meanOf(level(fine - 1, seeds), seeds, of, &varianceCoarse);
    got.value = meanOf(level(fine, seeds), seeds, of, &varianceFine);
    // Patches and texels of half the size leave a third of the difference (their error is of second order), in corners more: half.
    const double noise = fewSamples(int(seeds)) * std::sqrt(varianceFine), refinement = 0.5 * std::abs(got.value - coarse);
    got.standardError = std::hypot(noise, refinement);
    got.rounding = kFloat * (kRoundings + conditioning_) * std::abs(got.value);
    if (got.standardError <= standardError || got.value == 0.0) return got;
    const bool mayRefine = levels_[fine].front().patches * 4 <= kMostPatches, maySeed = seeds < kMostSeeds;
    if (mayRefine && (refinement > noise || !maySeed))
      ++fine;
    else if (maySeed)
      seeds = std::min(kMostSeeds, 2 * seeds);
    else
      return got;
  }
}

}  // namespace lmc
