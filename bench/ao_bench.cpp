/// Rays per second of the whole ambient-occlusion baker, 256 rays a texel, against bare Embree on the same rays, all of the map's, made
/// beforehand, in each of the forms that it offers. usage: ao_bench [LEVEL.glb] [benchmark options]; default samples/court.glb
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <memory>

#include "bench/bare_embree.h"
#include "libao/hemisphere.h"
#include "libradiosity/light_map.h"
#include "libscene/level.h"
#include "libscene/parallel.h"

namespace {

using namespace lmc;

constexpr std::uint32_t kRaysPerTexel = 256;
constexpr std::size_t kRays = 8'000'000;  // that lie in memory at a time, about: whole tiles
constexpr std::size_t kStream = 256;      // rays that Embree gets at a time

struct Bench {
  Scene scene;
  std::unique_ptr<Tracer> tracer;
  Charts charts;
  std::unique_ptr<TexelMap> texels;
  TexelArray<std::uint32_t> chart;
  std::unique_ptr<BareEmbree> bare;
};
Bench bench;

/// The rays of the tiles from one on, texel by texel, as the baker casts them, until there are enough; the tile after them.
std::size_t makeRays(std::size_t tile, std::vector<RTCRay>& rays) {
  const ao::Options options;
  const ao::Hemisphere hemisphere(*bench.tracer, options);
  rays.clear();
  for (; tile < bench.texels->tileCount() && rays.size() < kRays; ++tile) {
    const TexelTile t = bench.texels->texels(tile);
    for (std::uint32_t k = 0; k < kTile * kTile; ++k) {
      const auto [x, y] = alongMorton(k);
      if (x >= t.width || y >= t.height || t.at(x, y).coverage == 0.0f) continue;
      const TexelSampler sampler(bench.scene, t, t.at(x, y));
      const auto fans = hemisphere.fans(ao::addressOf(1, std::uint32_t(t.x0 + x), std::uint32_t(t.y0 + y)), kRaysPerTexel / 2,
                                        {[&](glm::vec2 u) { return sampler.at(u); }});
      for (const RayFan& f : fans)
        for (const RayFan::OneRay& from : f.rays) {
          if (from.tFar < 0.0f) continue;  // below the face: not asked
          RTCRay r{};
          r.org_x = from.origin_m.x, r.org_y = from.origin_m.y, r.org_z = from.origin_m.z;
          r.dir_x = from.direction.x, r.dir_y = from.direction.y, r.dir_z = from.direction.z;
          r.tfar = from.tFar;
          r.mask = ~0u;
          rays.push_back(r);
        }
    }
  }
  return tile;
}

void prepare(const char* level) {
  const Run run;
  bench.scene = loadLevel(level, {}, run);
  bench.tracer = std::make_unique<Tracer>(bench.scene);
  const int side = bench.scene.mapResolution > 0 ? bench.scene.mapResolution : 256;
  bench.charts = findCharts(bench.scene, side, run);
  bench.texels = std::make_unique<TexelMap>(bench.scene, bench.charts, side);
  bench.chart = startMap(bench.scene, *bench.texels, run).chart;
  bench.texels->keepAtMost(std::uint64_t(1) << 30);
  for (std::size_t t = 0; t < bench.texels->tileCount(); ++t) bench.texels->held(t);  // as direct light leaves them in a bake
  bench.bare = std::make_unique<BareEmbree>(bench.scene);
}

void report(benchmark::State& state, double rays) { state.counters["rays/s"] = benchmark::Counter(rays, benchmark::Counter::kIsRate); }

/// Every ray of the map; `pack` puts them into the form that `trace` takes, outside the clock.
template <class Pack, class Trace>
void bare(benchmark::State& state, const Pack& pack, const Trace& trace) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  double count = 0.0;
  std::vector<RTCRay> rays;
  for (auto _ : state) {
    std::chrono::duration<double> clocked{0.0};
    for (std::size_t tile = 0; tile < bench.texels->tileCount();) {
      tile = makeRays(tile, rays);
      count += double(rays.size());
      decltype(auto) packed = pack(rays);
      const auto start = std::chrono::steady_clock::now();
      trace(&context, packed);
      clocked += std::chrono::steady_clock::now() - start;
    }
    state.SetIterationTime(clocked.count());
  }
  report(state, count);
}

std::vector<RTCRay>& asTheyAre(std::vector<RTCRay>& rays) { return rays; }

void bareSingle(benchmark::State& state) {
  bare(state, asTheyAre, [](RTCIntersectContext* context, std::vector<RTCRay>& rays) {
    for (RTCRay& r : rays) rtcOccluded1(bench.bare->scene, context, &r);
  });
}

void bareStream(benchmark::State& state) {
  bare(state, asTheyAre, [](RTCIntersectContext* context, std::vector<RTCRay>& rays) {
    for (std::size_t i = 0; i < rays.size(); i += kStream)
      rtcOccluded1M(bench.bare->scene, context, &rays[i], unsigned(std::min(kStream, rays.size() - i)), sizeof(RTCRay));
  });
}

/// What is left of the last packet has tfar below 0 and is not traced.
template <class Packet>
std::vector<Packet> packets(const std::vector<RTCRay>& rays) {
  constexpr std::size_t n = sizeof(Packet::tfar) / sizeof(float);
  std::vector<Packet> out((rays.size() + n - 1) / n);
  for (Packet& p : out) std::fill(p.tfar, p.tfar + n, -1.0f);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    Packet& p = out[i / n];
    const RTCRay& r = rays[i];
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
  bare(state, packets<RTCRay8>, [&](RTCIntersectContext* context, std::vector<RTCRay8>& rays) {
    for (RTCRay8& r : rays) rtcOccluded8(valid, bench.bare->scene, context, &r);
  });
}

void barePacket16(benchmark::State& state) {
  alignas(64) int valid[16];
  std::fill(valid, valid + 16, -1);
  bare(state, packets<RTCRay16>, [&](RTCIntersectContext* context, std::vector<RTCRay16>& rays) {
    for (RTCRay16& r : rays) rtcOccluded16(valid, bench.bare->scene, context, &r);
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

BENCHMARK(bareSingle)->Unit(benchmark::kMillisecond)->UseManualTime();
BENCHMARK(barePacket8)->Unit(benchmark::kMillisecond)->UseManualTime();
BENCHMARK(barePacket16)->Unit(benchmark::kMillisecond)->UseManualTime();
BENCHMARK(bareStream)->Unit(benchmark::kMillisecond)->UseManualTime();
BENCHMARK(wholeBaker)->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  prepare(argc > 1 ? argv[1] : LMC_SOURCE_DIR "/samples/court.glb");
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
