/// Tangents per second: a sphere of 1,000,000 triangles, the same with a tenth degenerate, a fan of 1,000,000, and files of tangent
/// vectors. What two threads can gain on this machine is measured beside them: arithmetic that shares nothing and touches no memory.
/// usage: tangent_bench [FILE.tspace...] [benchmark options]
#include <benchmark/benchmark.h>

#include <array>

#include "lmc/tspace.h"
#include "tests/libtangent/surfaces.h"

namespace {

using namespace lmc;
using namespace lmc::tangent;

void measure(benchmark::State& state, const Surface& surface, int threads) {
  const Loop loop = threadedLoop(threads);
  for (auto _ : state) benchmark::DoNotOptimize(compute(surface, loop).corners.data());
  state.counters["triangles/s"] =
      benchmark::Counter(double(state.iterations()) * double(surface.indices.size() / 3), benchmark::Counter::kIsRate);
}

void add(const std::string& name, const Surface& surface) {
  for (const int threads : {1, 2})
    benchmark::RegisterBenchmark((name + "/threads:" + std::to_string(threads)).c_str(),
                                 [surface, threads](benchmark::State& state) { measure(state, surface, threads); })
        ->Unit(benchmark::kMillisecond)
        ->MeasureProcessCPUTime()
        ->UseRealTime();
}

/// 512 pieces of independent multiplications and additions, as many at once as the processor's units take.
void measureArithmetic(benchmark::State& state, int threads) {
  const Loop loop = threadedLoop(threads);
  for (auto _ : state)
    loop.each(512, [](std::size_t piece) {
      std::array<float, 64> x;
      x.fill(float(piece));
      for (int k = 0; k < 20000; ++k)
        for (float& v : x) v = v * 0.999f + 1.0f;
      benchmark::DoNotOptimize(x.data());
      benchmark::ClobberMemory();
    });
}

void addArithmetic() {
  for (const int threads : {1, 2})
    benchmark::RegisterBenchmark(("arithmetic/threads:" + std::to_string(threads)).c_str(),
                                 [threads](benchmark::State& state) { measureArithmetic(state, threads); })
        ->Unit(benchmark::kMillisecond)
        ->MeasureProcessCPUTime()
        ->UseRealTime();
}

}  // namespace

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  const OwnedSurface whole = sphere(1000, 501), round = fan(1000000);
  OwnedSurface tenth = whole;
  for (std::size_t t = 0; t < tenth.indices.size(); t += 30) tenth.indices[t] = tenth.indices[t + 1];
  addArithmetic();
  add("sphere", whole.view());
  add("sphere, a tenth degenerate", tenth.view());
  add("fan", round.view());
  std::vector<TangentVectors> files;
  files.reserve(std::size_t(argc));
  for (int i = 1; i < argc; ++i) {
    files.push_back(readTangentVectors(argv[i]));
    add(argv[i], files.back().surface());
  }
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
