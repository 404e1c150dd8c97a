/// Rays per second of the whole ambient-occlusion baker, 256 rays a texel, against bare Embree on the same rays, made beforehand, in each
/// of the forms that it offers. usage: ao_bench [LEVEL.glb] [benchmark options]; default samples/court.glb
#include <benchmark/benchmark.h>

#include <memory>

#include "bench/bare_embree.h"
#include "libao/hemisphere.h"
#include "libradiosity/light_map.h"
#include "libscene/level.h"
#include "libscene/parallel.h"

namespace {

using namespace lmc;

constexpr std::uint32_t kRaysPerTexel = 256;
constexpr std::size_t kRays = 8'000'000;  // about: whole tiles, spread over the maps, so that neighbours follow each other as in a bake

struct Bench {
  Scene scene;
  std::unique_ptr<Tracer> tracer;
  Charts charts;
  std::unique_ptr<TexelMap> texels;
  TexelArray<std::uint32_t> chart;  ///< of the texels in those tiles
  std::vector<RTCRay> rays;          ///< texel by texel
  std::unique_ptr<BareEmbree> bare;
};
Bench bench;

void makeRays() {
  const ao::Options options;
  const ao::Hemisphere hemisphere(*bench.tracer, options);
  std::size_t covered = 0;
  for (const std::uint32_t c : bench.chart) covered += c != kNone;
  const std::size_t step = std::max<std::size_t>(1, covered * kRaysPerTexel / kRays);
  TexelArray<std::uint32_t> chart(bench.chart.size(), kNone);
  for (std::size_t t = 0; t < bench.texels->tileCount(); t += step) {
    const TexelTile tile = bench.texels->texels(t);
    for (std::uint32_t k = 0; k < kTile * kTile; ++k) {
      const auto [x, y] = alongMorton(k);
      if (x >= tile.width || y >= tile.height || tile.at(x, y).coverage == 0.0f) continue;
      chart[std::size_t(tile.y0 + y) * std::size_t(bench.texels->width()) + std::size_t(tile.x0 + x)] = tile.at(x, y).chart;
      const TexelSampler sampler(bench.scene, tile, tile.at(x, y));
      const auto fans = hemisphere.fans(ao::addressOf(1, std::uint32_t(tile.x0 + x), std::uint32_t(tile.y0 + y)), kRaysPerTexel / 2,
                                        {[&](glm::vec2 u) { return sampler.at(u); }});
      for (const RayFan& f : fans)
        for (std::size_t i = 0; i < RayFan::kRays; ++i) {
          RTCRay r{};
          r.org_x = f.origin_m.x, r.org_y = f.origin_m.y, r.org_z = f.origin_m.z;
          r.dir_x = f.towards[i].x, r.dir_y = f.towards[i].y, r.dir_z = f.towards[i].z;
          r.tfar = (f.wanted >> i & 1) != 0 ? f.tFar : -1.0f;  // below the face: not asked
          r.mask = ~0u;
          bench.rays.push_back(r);
        }
    }
  }
  bench.chart = std::move(chart);
}

void prepare(const char* level) {
  const Run run;
  bench.scene = loadLevel(level, {}, run);
  bench.tracer = std::make_unique<Tracer>(bench.scene);
  const int side = bench.scene.mapResolution > 0 ? bench.scene.mapResolution : 256;
  bench.charts = findCharts(bench.scene, side, run);
  bench.texels = std::make_unique<TexelMap>(bench.scene, bench.charts, side);
  bench.chart = startMap(bench.scene, *bench.texels, run).chart;
  makeRays();
  bench.bare = std::make_unique<BareEmbree>(bench.scene);
}

void report(benchmark::State& state, double rays) { state.counters["rays/s"] = benchmark::Counter(rays, benchmark::Counter::kIsRate); }

/// `trace` gets a texel's rays, fresh copies of which are made outside the clock.
template <class Ray, class Trace>
void bare(benchmark::State& state, const std::vector<Ray>& made, const Trace& trace) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  const std::size_t perTexel = made.size() * kRaysPerTexel / bench.rays.size();
  for (auto _ : state) {
    state.PauseTiming();
    std::vector<Ray> rays = made;
    state.ResumeTiming();
    for (std::size_t i = 0; i < rays.size(); i += perTexel) trace(&context, &rays[i]);
  }
  report(state, double(state.iterations()) * double(bench.rays.size()));
}

void bareSingle(benchmark::State& state) {
  bare(state, bench.rays, [](RTCIntersectContext* context, RTCRay* rays) {
    for (std::uint32_t i = 0; i < kRaysPerTexel; ++i) rtcOccluded1(bench.bare->scene, context, rays + i);
  });
}

void bareStream(benchmark::State& state) {
  bare(state, bench.rays,
       [](RTCIntersectContext* context, RTCRay* rays) { rtcOccluded1M(bench.bare->scene, context, rays, kRaysPerTexel, sizeof(RTCRay)); });
}

template <class Packet>
std::vector<Packet> packets() {
  constexpr std::size_t n = sizeof(Packet::tfar) / sizeof(float);
  std::vector<Packet> out(bench.rays.size() / n);
  for (std::size_t i = 0; i < bench.rays.size(); ++i) {
    Packet& p = out[i / n];
    const RTCRay& r = bench.rays[i];
    const std::size_t l = i % n;
    p.org_x[l] = r.org_x, p.org_y[l] = r.org_y, p.org_z[l] = r.org_z;
    p.dir_x[l] = r.dir_x, p.dir_y[l] = r.dir_y, p.dir_z[l] = r.dir_z;
    p.tfar[l] = r.tfar, p.mask[l] = r.mask;
  }
  return out;
}

void barePacket8(benchmark::State& state) {
  alignas(32) int valid[8];
  std::fill(valid, valid + 8, -1);
  bare(state, packets<RTCRay8>(), [&](RTCIntersectContext* context, RTCRay8* rays) {
    for (std::uint32_t i = 0; i < kRaysPerTexel / 8; ++i) rtcOccluded8(valid, bench.bare->scene, context, rays + i);
  });
}

void barePacket16(benchmark::State& state) {
  alignas(64) int valid[16];
  std::fill(valid, valid + 16, -1);
  bare(state, packets<RTCRay16>(), [&](RTCIntersectContext* context, RTCRay16* rays) {
    for (std::uint32_t i = 0; i < kRaysPerTexel / 16; ++i) rtcOccluded16(valid, bench.bare->scene, context, rays + i);
  });
}

void wholeBaker(benchmark::State& state) {
  Run run;
  run.threads = int(state.range(0));
  double rays = 0.0;
  withThreads(run, [&] {
    for (auto _ : state)
      rays += double(ao::bakeMap(bench.scene, *bench.texels, bench.chart, *bench.tracer, {.rays = kRaysPerTexel}, run).rays);
  });
  report(state, rays);
}

BENCHMARK(bareSingle)->Unit(benchmark::kMillisecond);
BENCHMARK(barePacket8)->Unit(benchmark::kMillisecond);
BENCHMARK(barePacket16)->Unit(benchmark::kMillisecond);
BENCHMARK(bareStream)->Unit(benchmark::kMillisecond);
BENCHMARK(wholeBaker)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  prepare(argc > 1 ? argv[1] : LMC_SOURCE_DIR "/samples/court.glb");
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
