#pragma once
/// Values of a whole bake (patches, solver, gather) with their standard error, from several seeds and two sizes of patch and texel.
#include <functional>

#include "libscene/scene_builder.h"
#include "lmc/bake_scene.h"
#include "lmc/verify_case.h"

namespace lmc {

/// One level baked as often as the values asked for need it; bakes are kept and serve all values.
class Bakes {
 public:
  /// `side` and `patchSize_m`: of the coarsest bakes.
  Bakes(Scene scene, BakeSceneOptions options, const VerifyContext& context);

  /// The mean over seeds at the finest sizes of patch and texel baked. Its standard error: spread over the seeds, and half of what twice
  /// these sizes make of it, in squares. Bakes more (seeds, or finer) until it is `standardError` or a limit is reached.
  Got value(double standardError, const std::function<double(const Baked&)>& of);

 private:
  const std::vector<Baked>& level(std::size_t refinement, std::size_t seeds);
  Scene scene_;
  BakeSceneOptions options_;
  VerifyContext context_;
  std::vector<std::vector<Baked>> levels_;  // [refinement][seed]
  double conditioning_ = 1.0;
};

}  // namespace lmc
