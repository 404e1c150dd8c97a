#include "lmc/bake_scene.h"

#include <algorithm>
#include <cmath>

#include "libradiosity/solve_stored.h"
#include "libscene/parallel.h"
#include "libscene/sampling.h"

namespace lmc {

namespace {

constexpr std::uint32_t kDirectPlaces = 64;
constexpr std::uint64_t kPlaceAddress = 0x91ace5;  // of random numbers, apart from those of texels

SurfacePoint surfacePoint(const Scene& scene, const QuadPlace& place) {
  // A quad's triangles: (0, 0) (1, 0) (1, 1) and (0, 0) (1, 1) (0, 1).
  const std::uint32_t first = scene.objects[place.object].firstTriangle;
  return place.u >= place.v ? surfacePoint(scene, first, {place.u - place.v, place.v})
                            : surfacePoint(scene, first + 1, {place.u, place.v - place.u});
}

/// E at a place: direct light as a texel gets it, the rest by hemisphere rays over the patches.
glm::dvec3 illuminanceAt(const Scene& scene, const Tracer& tracer, const DirectLight& direct, const Field* field, const QuadPlace& at,
                         std::uint32_t index, const BakeSceneOptions& o) {
  const SurfacePoint p = surfacePoint(scene, at);
  const std::vector<SurfacePoint> same(kDirectPlaces, p);
  glm::dvec3 e =
      direct.sample(same, direct.lightsFor(p.position_m, 0.0), sequence(o.seed, Draw::Direct, kPlaceAddress, 0, index, 0, 0)).illuminance;
  if (!field) return e;
  const glm::dmat3 frame = frameAbout(p.normal);
  const glm::vec3 from = tracer.lifted(p.position_m, p.geometricNormal);
  const Sobol4 numbers = sequence(o.seed, Draw::Hemisphere, kPlaceAddress, 0, index, 0, 0);
  glm::dvec3 sum(0.0);
  for (std::uint32_t k = 0; k < o.raysPerPlace; ++k)
    if (const Hit hit = tracer.closest({from, glm::vec3(frame * cosineHemisphere(numbers.point2(k))), INFINITY}, Purpose::Gather))
      sum += glm::dvec3(field->at(hit, 0).exitance);
  return e + sum / double(o.raysPerPlace);
}

std::vector<float> coverageOf(const TexelMap& texels) {
  std::vector<float> coverage(std::size_t(texels.width()) * std::size_t(texels.height()), 0.0f);
  for (std::size_t t = 0; t < texels.tileCount(); ++t) {
    const TexelTile tile = texels.texels(t);
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x)
        coverage[std::size_t(tile.y0 + y) * std::size_t(texels.width()) + std::size_t(tile.x0 + x)] = tile.at(x, y).coverage;
  }
  return coverage;
}

}  // namespace

glm::dvec3 Baked::meanOf(std::uint32_t object, bool withDirect) const {
  glm::dvec3 sum(0.0);
  double n = 0.0;
  for (std::size_t i = 0; i < map.size(); ++i)
    if (map.chart[i] != kNone && map.object[i] == object) {
      const double share = coverage[i];
      sum += share * glm::dvec3(values.indirect[i]);
      if (withDirect) sum += share * glm::dvec3(values.direct[i]);
      n += share;
    }
  return n > 0.0 ? sum / n : sum;
}

Baked bakeScene(const Scene& scene, const BakeSceneOptions& o) {
  Run run;
  run.threads = o.threads;
  run.seed = o.seed;
  Baked out;
  withThreads(run, [&] {
    const Charts charts = findCharts(scene, o.side, run);
    const TexelMap texels(scene, charts, o.side);
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
      const PatchLight light = lightPatches(scene, tracer, mesh, direct, seen, run, patchSkyRaysFor(o.goal));
      Solution second;
      if (o.solver == Solver::Dense) {
        out.solution = solveDense(mesh, computeFormFactors(scene, tracer, mesh, run), light, {});
      } else if (o.solver == Solver::Stored) {
        StoredOptions stored;
        stored.rays = storedRaysFor(o.goal, mesh.patches.size());
        out.solution = solveStored(scene, tracer, mesh, light, stored, run).solution;
        stored.stream = 1;
        second = solveStored(scene, tracer, mesh, light, stored, run).solution;
      } else {
        out.solution = shoot(scene, tracer, mesh, light, {}, run);
      }
      const Bounced &first = out.solution.illuminance, &other = second.illuminance.empty() ? first : second.illuminance;
      field = std::make_unique<Field>(scene, mesh, seen, texels, light, std::array<const Bounced*, 2>{&first, &other}, nullptr, run);
    }
    if (field || strength(scene.sky) > 0.0f)
      bakeHemisphere(out.map, scene, texels, tracer, Gather(scene, tracer, direct, field.get(), true, run.seed),
                     {o.goal, o.interpolate, out.solution.tail}, run);
    out.values = values(out.map, scene);
    out.ledger = ledger(out.map, scene, {out.solution.tail, out.solution.tailEstimate});
    out.coverage = coverageOf(texels);
    out.patches = mesh.patches.size();
    out.places.resize(o.places.size());
    parallelFor(run, o.places.size(), 1, [&](std::size_t i) {
      out.places[i] = illuminanceAt(scene, tracer, direct, field.get(), o.places[i], std::uint32_t(i), o);
    });
    out.rays = tracer.rays();
  });
  return out;
}

}  // namespace lmc
