/// Rays per second of lmc's tracer against bare Embree on the same rays: the hemisphere rays of a level's texels, 256 a texel.
/// usage: tracer_bench [LEVEL.glb] [benchmark options]; default samples/court.glb
#include <benchmark/benchmark.h>

#include <memory>

#include "bench/bare_embree.h"
#include "libscene/level.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"
#include "libscene/sampling.h"
#include "libscene/texels.h"
#include "libscene/tracer.h"

namespace {

using namespace lmc;

constexpr std::uint32_t kRaysPerTexel = 256;
constexpr std::size_t kTexels = 2000;

struct Bench {
  Scene scene;
  std::unique_ptr<Tracer> tracer;
  std::vector<Ray> rays;
  std::vector<Hit> hits;
  std::vector<std::uint8_t> blocked;
  std::unique_ptr<BareEmbree> bare;
};
Bench bench;

void prepare(const char* level) {
  const Run run;
  bench.scene = loadLevel(level, {}, run);
  bench.tracer = std::make_unique<Tracer>(bench.scene);
  const int side = bench.scene.mapResolution > 0 ? bench.scene.mapResolution : 256;
  const Charts charts = findCharts(bench.scene, side, run);
  const TexelMap map(bench.scene, charts, side);
  // Texels spread evenly over the covered ones, in the order of tiles: as a bake meets them.
  std::vector<std::pair<std::size_t, int>> covered;
  for (std::size_t t = 0; t < map.tileCount(); ++t) {
    const TexelTile tile = map.texels(t);
    for (int i = 0; i < tile.width * tile.height; ++i)
      if (tile.at(i % tile.width, i / tile.width).fragmentCount > 0) covered.emplace_back(t, i);
  }
  const std::size_t step = std::max<std::size_t>(1, covered.size() / kTexels);
  for (std::size_t c = 0; c < covered.size(); c += step) {
    const TexelTile tile = map.texels(covered[c].first);
    const int x = covered[c].second % tile.width, y = covered[c].second / tile.width;
    const Sobol4 numbers = sequence(1, Draw::Hemisphere, 0, 0, std::uint32_t(tile.x0 + x), std::uint32_t(tile.y0 + y), 0);
    const TexelSampler sampler(bench.scene, tile, tile.at(x, y));
    for (std::uint32_t k = 0; k < kRaysPerTexel; ++k) {
      const glm::vec4 u = numbers.point(k);
      const SurfacePoint p = sampler.at({u.z, u.w});
      bench.rays.push_back({bench.tracer->lifted(p.position_m, p.geometricNormal),
                            glm::vec3(frameAbout(p.geometricNormal) * cosineHemisphere({u.x, u.y})), INFINITY});
    }
  }
  bench.hits.resize(bench.rays.size());
  bench.blocked.resize(bench.rays.size());

  bench.bare = std::make_unique<BareEmbree>(bench.scene);
}

std::vector<RTCRayHit> bareRays() {
  std::vector<RTCRayHit> out(bench.rays.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    RTCRay& r = out[i].ray;
    const Ray& f = bench.rays[i];
    r = {f.origin_m.x, f.origin_m.y, f.origin_m.z, 0.0f, f.direction.x, f.direction.y, f.direction.z, 0.0f, f.tFar, ~0u, 0, 0};
    out[i].hit.geomID = RTC_INVALID_GEOMETRY_ID;
    out[i].hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  }
  return out;
}

void report(benchmark::State& state) {
  state.counters["rays/s"] = benchmark::Counter(double(state.iterations()) * double(bench.rays.size()), benchmark::Counter::kIsRate);
}

/// Bare Embree over fresh copies of the rays, made outside the clock; `trace` gets one texel's.
template <class Trace>
void bare(benchmark::State& state, Trace trace) {
  for (auto _ : state) {
    state.PauseTiming();
    auto rays = bareRays();
    state.ResumeTiming();
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    for (std::size_t i = 0; i < rays.size(); i += kRaysPerTexel) trace(&context, &rays[i]);
  }
  report(state);
}
void bareClosestSingle(benchmark::State& state) {
  bare(state, [](RTCIntersectContext* context, RTCRayHit* rays) {
    for (std::uint32_t i = 0; i < kRaysPerTexel; ++i) rtcIntersect1(bench.bare->scene, context, rays + i);
  });
}
void bareClosestStream(benchmark::State& state) {
  bare(state, [](RTCIntersectContext* context, RTCRayHit* rays) {
    rtcIntersect1M(bench.bare->scene, context, rays, kRaysPerTexel, sizeof(RTCRayHit));
  });
}
void bareOccludedStream(benchmark::State& state) {
  bare(state, [](RTCIntersectContext* context, RTCRayHit* rays) {
    rtcOccluded1M(bench.bare->scene, context, &rays->ray, kRaysPerTexel, sizeof(RTCRayHit));
  });
}
void lmcClosest(benchmark::State& state) {
  for (auto _ : state)
    for (std::size_t i = 0; i < bench.rays.size(); i += kRaysPerTexel)
      bench.tracer->closest({&bench.rays[i], kRaysPerTexel}, {&bench.hits[i], kRaysPerTexel}, Purpose::Gather);
  report(state);
}
void lmcOccluded(benchmark::State& state) {
  for (auto _ : state)
    for (std::size_t i = 0; i < bench.rays.size(); i += kRaysPerTexel)
      bench.tracer->occluded({&bench.rays[i], kRaysPerTexel}, {&bench.blocked[i], kRaysPerTexel}, Purpose::Sky);
  report(state);
}
BENCHMARK(bareClosestSingle)->Unit(benchmark::kMillisecond);
BENCHMARK(bareClosestStream)->Unit(benchmark::kMillisecond);
BENCHMARK(lmcClosest)->Unit(benchmark::kMillisecond);
BENCHMARK(bareOccludedStream)->Unit(benchmark::kMillisecond);
BENCHMARK(lmcOccluded)->Unit(benchmark::kMillisecond);

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  prepare(argc > 1 ? argv[1] : LMC_SOURCE_DIR "/samples/court.glb");
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
