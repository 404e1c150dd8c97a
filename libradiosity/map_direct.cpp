#include <algorithm>
#include <cmath>

#include "libradiosity/light_map.h"
#include "libscene/parallel.h"

namespace lmc {

namespace {

constexpr std::uint32_t kPilotPlaces = 8;  // each half, on every texel that a light may reach

/// Places on the edge texels of shadows, each half: their error falls about as n^-0.75 and they are a few percent of a map.
std::uint32_t edgePlaces(double goal) { return goal <= 0.01 ? 128 : goal <= 0.04 ? 64 : 32; }

struct Sphere {
  glm::dvec3 centre{0.0};
  double radius = -1.0;
};

/// Holds every covered place of the tile: the corners of its fragments are the extremes of flat pieces.
Sphere boundsOf(const Scene& scene, const TexelTile& tile) {
  glm::dvec3 lo(1e300), hi(-1e300);
  for (const Fragment& f : tile.fragments) {
    const auto c = scene.corners_m(f.triangle);
    for (std::uint32_t k = 0; k < f.cornerCount; ++k) {
      const glm::dvec2 p = tile.corners[f.firstCorner + k];
      const glm::dvec2 b = f.bary0 + p.x * f.baryX + p.y * f.baryY;
      const glm::dvec3 at = c[0] + b.x * (c[1] - c[0]) + b.y * (c[2] - c[0]);
      lo = glm::min(lo, at);
      hi = glm::max(hi, at);
    }
  }
  if (tile.fragments.empty()) return {};
  return {0.5 * (lo + hi), 0.5 * glm::length(hi - lo) * (1.0 + 1e-9)};
}

/// Direct light of one texel, both halves.
struct TexelDirect {
  std::array<DirectSample, 2> half;
  bool settled(double goal) const {
    const glm::dvec3 a = half[0].illuminance, b = half[1].illuminance, d = glm::abs(a - b), s = a + b;
    return !half[0].mixed && !half[1].mixed && half[0].signature == half[1].signature &&
           std::max({d.x, d.y, d.z}) <= 0.5 * goal * std::max({s.x, s.y, s.z});
  }
};

TexelDirect directOf(const Scene& scene, const TexelTile& tile, int x, int y, const DirectLight& direct,
                     std::span<const std::uint32_t> lights, std::uint32_t places, std::uint64_t seed) {
  TexelDirect out;
  std::vector<SurfacePoint> at(places);
  const TexelSampler sampler(scene, tile, tile.at(x, y));
  for (std::uint32_t h = 0; h < 2; ++h) {
    const Sobol4 numbers = sequence(seed, Draw::Direct, 0, 0, std::uint32_t(tile.x0 + x), std::uint32_t(tile.y0 + y), h);
    for (std::uint32_t k = 0; k < places; ++k) {
      const glm::vec4 u = numbers.point(k);
      at[k] = sampler.at({u.z, u.w});
    }
    out.half[h] = direct.sample(at, lights, numbers);
  }
  return out;
}

}  // namespace

void bakeDirect(LightMap& map, const Scene& scene, const TexelMap& texels, const DirectLight& direct, const MapOptions& options,
                const Run& run) {
  if (!direct.any()) return;
  parallelFor(run, texels.tileCount(), 1, [&](std::size_t t) {
    const TexelTile tile = texels.texels(t);
    const Sphere bounds = boundsOf(scene, tile);
    if (bounds.radius < 0.0) return;
    const std::vector<std::uint32_t> lights = direct.lightsFor(bounds.centre, bounds.radius);
    if (lights.empty() && !direct.hasEmitters()) return;
    constexpr int kSpan = kTile + 2 * kApron;
    std::vector<TexelDirect> pilot(std::size_t(kSpan) * kSpan);
    const auto cell = [](int x, int y) { return std::size_t(y + kApron) * kSpan + std::size_t(x + kApron); };
    for (int y = -kApron; y < tile.height + kApron; ++y)
      for (int x = -kApron; x < tile.width + kApron; ++x)
        if (tile.at(x, y).fragmentCount > 0) pilot[cell(x, y)] = directOf(scene, tile, x, y, direct, lights, kPilotPlaces, run.seed);
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        const Texel& texel = tile.at(x, y);
        if (texel.fragmentCount == 0) continue;
        TexelDirect here = pilot[cell(x, y)];
        // Few places prove little: a texel is taken as plainly lit or dark only when its neighbours on the chart say the same.
        bool settled = here.settled(options.goal);
        for (int dy = -1; dy <= 1 && settled; ++dy)
          for (int dx = -1; dx <= 1 && settled; ++dx) {
            const Texel& other = tile.at(x + dx, y + dy);
            if (other.fragmentCount == 0 || other.chart != texel.chart) continue;
            const TexelDirect& there = pilot[cell(x + dx, y + dy)];
            settled = there.half[0].signature == here.half[0].signature && !there.half[0].mixed && !there.half[1].mixed;
          }
        if (!settled) here = directOf(scene, tile, x, y, direct, lights, edgePlaces(options.goal), run.seed);
        const std::size_t i = map.index(tile, x, y);
        map.edge[i] = !settled;
        for (std::size_t h = 0; h < 2; ++h) map.direct[h][i] = Rgb(here.half[h].illuminance);
      }
  });
}

}  // namespace lmc
