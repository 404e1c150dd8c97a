#include "libradiosity/adaptive_patches.h"

#include <algorithm>
#include <span>

#include "libradiosity/slopes.h"
#include "libradiosity/solve_stored.h"
#include "libscene/parallel.h"
#include "libscene/texel_array.h"
#include "libscene/texture.h"

namespace lmc {

namespace {

constexpr double kRays = 16.0, kLeastRays = 32768.0;  // of a patch; of all: slopes are wanted, not values
constexpr double kMaxTail = 0.01;
constexpr std::uint32_t kStream = 2;  // apart from those of the solution

float mean3(const Rgb& c) { return (c.r + c.g + c.b) / 3.0f; }

/// Light by the sky and by bounces at the texels' middles [lx].
TexelArray<Rgb> indirectOf(const Scene& scene, const Tracer& tracer, const DirectLight& direct, const DirectMap& map,
                           const TexelMap& texels, PatchMesh mesh, const Run& run) {
  for (Patch& p : mesh.patches) p.reflectance = glm::min(p.reflectance, Rgb(kMostReflectance));
  exposePatches(mesh, scene, tracer, run);
  PatchLight light = lightPatches(scene, tracer, mesh, direct, map, run);
  StoredOptions options;
  options.rays = std::uint32_t(std::max(kRays, kLeastRays / double(std::max<std::size_t>(1, mesh.patches.size()))));
  options.maxTail = kMaxTail;
  options.stream = kStream;
  const Bounced bounced = solveStored(scene, tracer, mesh, light, options, run).solution.illuminance;
  for (std::size_t i = 0; i < bounced.size(); ++i) light.sky[i] += bounced[i];
  const TexelPatches places(scene, mesh, texels, run);
  const PatchGroups single = singlePatches(mesh);
  const Slopes slopes(mesh, map, places, single);
  const Sloped indirect = slopes.of(std::move(light.sky));
  TexelArray<Rgb> out(places.patch.size());
  for (std::size_t i = 0; i < out.size(); ++i)
    if (places.patch[i] != kNone) out[i] = slopes.at(indirect, i);
  return out;
}

}  // namespace

PatchMesh makeAdaptivePatches(const Scene& scene, const Tracer& tracer, const DirectLight& direct, const DirectMap& map,
                              const TexelMap& texels, const PatchOptions& coarsest, const Run& run) {
  const Run quiet = run.quiet();
  PatchOptions options = coarsest;
  options.levels = 0;
  PatchMesh mesh = makePatches(scene, options, quiet);
  options.size_m = mesh.size_m;
  options.levels = coarsest.levels;
  TexelArray<Rgb> indirect = indirectOf(scene, tracer, direct, map, texels, std::move(mesh), quiet);
  TexelArray<LightAt> light(indirect.size());
  parallelFor(quiet, texels.tileCount(), 1, [&](std::size_t t) {
    const auto held = texels.held(t);
    const TexelTile& tile = *held;
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        if (tile.at(x, y).fragmentCount == 0) continue;
        const std::size_t i = std::size_t(tile.y0 + y) * std::size_t(map.width) + std::size_t(tile.x0 + x);
        const Fragment& f = tile.fragments[tile.at(x, y).firstFragment];
        const auto c = scene.corners_m(f.triangle);
        const glm::dvec3 du = f.baryX.x * (c[1] - c[0]) + f.baryX.y * (c[2] - c[0]),
                         dv = f.baryY.x * (c[1] - c[0]) + f.baryY.y * (c[2] - c[0]);
        const SurfacePoint p = TexelSampler(scene, tile, tile.at(x, y)).middle();
        light[i] = {p.triangle, p.bary, float(double(tile.at(x, y).coverage) * glm::length(glm::cross(du, dv))),
                    mean3(reflectanceAt(scene, p.triangle, p.bary) * (map.illuminance[i] + indirect[i]))};
      }
  });
  indirect.clear();
  const auto end = std::remove_if(light.begin(), light.end(), [](const LightAt& l) { return !(l.area_m2 > 0.0f); });
  options.light = std::span<const LightAt>(light.begin(), end);
  return makePatches(scene, options, run);
}

}  // namespace lmc
