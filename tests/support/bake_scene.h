#pragma once
/// The stages of a bake on a scene made in code, by the libraries alone.
#include <memory>

#include "libradiosity/light_map.h"
#include "libradiosity/solve.h"
#include "libscene/parallel.h"

namespace lmc::test {

struct Baked {
  LightMap map;
  LightMapValues values;
  ErrorLedger ledger;
  Solution solution;
  std::uint64_t rays = 0;

  /// Mean of E over an object's texels [lx].
  glm::dvec3 mean(std::uint32_t object) const {
    glm::dvec3 sum(0.0);
    double n = 0.0;
    for (std::size_t i = 0; i < map.size(); ++i)
      if (map.chart[i] != kNone && map.object[i] == object) {
        sum += glm::dvec3(values.direct[i] + values.indirect[i]);
        n += 1.0;
      }
    return sum / std::max(1.0, n);
  }
};

struct BakeSceneOptions {
  int side = 64;
  double goal = 0.02;
  double patchSize_m = 0.5;
  bool dense = false;
  bool bounce = true;
  int threads = 0;
  bool interpolate = true;
};

inline Baked bakeScene(const Scene& scene, const BakeSceneOptions& o = {}) {
  Run run;
  run.threads = o.threads;
  Baked out;
  withThreads(run, [&] {
    const Charts charts = findCharts(scene, o.side, run);
    const TexelMap texels(scene, charts, o.side, o.side);
    const Tracer tracer(scene);
    const DirectLight direct(scene, tracer, true);
    out.map = startMap(scene, texels, run);
    bakeDirect(out.map, scene, texels, direct, {o.goal}, run);
    std::vector<Rgb> mean(out.map.size());
    for (std::size_t i = 0; i < mean.size(); ++i) mean[i] = 0.5f * (out.map.direct[0][i] + out.map.direct[1][i]);
    const DirectMap seen{o.side, o.side, mean.data(), out.map.chart.data(), &charts, out.map.edge.data()};
    std::unique_ptr<Field> field;
    PatchMesh mesh;
    if (o.bounce) {
      mesh = makePatches(scene, {.size_m = o.patchSize_m}, run);
      exposePatches(mesh, scene, tracer, run);
      const PatchLight light = lightPatches(scene, tracer, mesh, direct, seen, run);
      out.solution =
          o.dense ? solveDense(mesh, computeFormFactors(scene, tracer, mesh, run), light, {}) : shoot(scene, tracer, mesh, light, {}, run);
      field = std::make_unique<Field>(scene, mesh, seen, &texels, light,
                                      std::array<const Bounced*, 2>{&out.solution.illuminance, &out.solution.illuminance}, nullptr, run);
    }
    if (field || strength(scene.sky) > 0.0f)
      bakeHemisphere(out.map, scene, texels, tracer, Gather(scene, tracer, direct, field.get(), true, run.seed), {o.goal, o.interpolate}, run);
    out.values = values(out.map, scene);
    out.ledger = ledger(out.map, scene, out.solution.tail, out.solution.tailEstimate);
    out.rays = tracer.rays();
  });
  return out;
}

}  // namespace lmc::test
