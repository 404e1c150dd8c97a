#pragma once
/// The stages of a bake on a scene made in code, by the libraries alone: for tests and for reference cases.
#include <memory>

#include "libradiosity/light_map.h"
#include "libradiosity/solve.h"
#include "lmc/options.h"

namespace lmc {

/// A place on a quad of SceneBuilder (cuts = 1), by its shares of the sides u and v.
struct QuadPlace {
  std::uint32_t object = 0;
  double u = 0.5, v = 0.5;
};

struct Baked {
  LightMap map;
  LightMapValues values;
  ErrorLedger ledger;
  Solution solution;  ///< that of the first half, where the halves have one each
  std::uint64_t rays = 0;
  std::size_t patches = 0;
  std::vector<float> coverage;     ///< of each texel, its share in its chart
  std::vector<glm::dvec3> places;  ///< E at BakeSceneOptions::places [lx]

  /// Mean of E over an object, texels by what its chart covers of them [lx].
  glm::dvec3 mean(std::uint32_t object) const { return meanOf(object, true); }
  glm::dvec3 meanIndirect(std::uint32_t object) const { return meanOf(object, false); }

 private:
  glm::dvec3 meanOf(std::uint32_t object, bool withDirect) const;
};

struct BakeSceneOptions {
  int side = 64;
  double goal = 0.02;
  double patchSize_m = 0.5;
  Solver solver = Solver::Shooting;  ///< or Dense or Stored
  bool bounce = true;
  int threads = 0;
  bool interpolate = true;  ///< MapOptions
  std::uint64_t seed = 1;
  std::vector<QuadPlace> places{};    ///< where E is wanted beside the texels
  std::uint32_t raysPerPlace = 4096;  ///< hemisphere rays
};

Baked bakeScene(const Scene&, const BakeSceneOptions& = {});

}  // namespace lmc
