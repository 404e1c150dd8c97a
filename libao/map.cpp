#include <algorithm>
#include <memory>
#include <numeric>
#include <unordered_map>

#include "libao/rounds.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"

namespace lmc::ao {

namespace {

constexpr int kPoolSide = 4;      // texels
constexpr double kOpen = 0.05;    // beside less, a dark rim would hardly show
constexpr double kDarker = 0.25;  // than the most open neighbour

/// Blocks of texels of one chart.
std::uint32_t makePools(std::span<const std::uint32_t> chart, int width, std::vector<std::uint32_t>& poolOf) {
  std::unordered_map<std::uint64_t, std::uint32_t> known;
  for (std::size_t i = 0; i < chart.size(); ++i) {
    if (chart[i] == kNone) continue;
    const auto x = i % std::size_t(width) / kPoolSide, y = i / std::size_t(width) / kPoolSide;
    poolOf[i] = known.try_emplace(combine(chart[i], x << 32 | y), std::uint32_t(known.size())).first->second;
  }
  return std::uint32_t(known.size());
}

/// f(j) for the eight neighbours of a texel in its chart.
template <class F>
void forNeighbours(std::span<const std::uint32_t> chart, int width, std::size_t i, const F& f) {
  const int x = int(i % std::size_t(width)), y = int(i / std::size_t(width)), height = int(chart.size() / std::size_t(width));
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      if ((dx == 0 && dy == 0) || x + dx < 0 || y + dy < 0 || x + dx >= width || y + dy >= height) continue;
      const std::size_t j = std::size_t(y + dy) * std::size_t(width) + std::size_t(x + dx);
      if (chart[j] == chart[i]) f(j);
    }
}

/// Whether a texel is nearly dark beside one that is not.
bool isDarkBesideOpen(std::span<const Sums> sums, std::span<const std::uint32_t> chart, int width, std::size_t i) {
  if (chart[i] == kNone || sums[i].middle != Sums::Middle::Unknown) return false;
  double beside = 0.0;
  forNeighbours(chart, width, i, [&](std::size_t j) { beside = std::max(beside, sums[j].uniform()); });
  return beside > kOpen && sums[i].uniform() < kDarker * beside;
}

}  // namespace

Openness bakeMap(const Scene& scene, const TexelMap& texels, std::span<const std::uint32_t> chart, const Tracer& tracer,
                 const Options& options, const Run& run) {
  const std::size_t n = chart.size();
  std::vector<std::uint32_t> poolOf(n, kNone);
  const std::uint32_t pools = makePools(chart, texels.width(), poolOf);
  std::vector<Sums> sums(n);
  std::vector<glm::vec3> bent(options.bent ? n : 0, glm::vec3(0.0f));
  const Hemisphere hemisphere(tracer, options);
  /// f(texel, its places, its random numbers' address) gives the rays it cast, for texels that are `wanted`; returns their sum.
  const auto forTexels = [&](const Run& part, const auto& wanted, const auto& f) {
    std::vector<std::uint64_t> rays(texels.tileCount(), 0);
    parallelFor(part, texels.tileCount(), 1, [&](std::size_t t) {
      const int x0 = int(t % std::size_t(texels.tilesX())) * kTile, y0 = int(t / std::size_t(texels.tilesX())) * kTile;
      std::unique_ptr<TexelTile> tile;
      for (std::uint32_t k = 0; k < kTile * kTile; ++k) {
        const auto [x, y] = alongMorton(k);
        if (x0 + x >= texels.width() || y0 + y >= texels.height()) continue;
        const std::size_t i = std::size_t(y0 + y) * std::size_t(texels.width()) + std::size_t(x0 + x);
        if (!wanted(i)) continue;
        if (!tile) tile = std::make_unique<TexelTile>(texels.texels(t));
        const TexelSampler sampler(scene, *tile, tile->at(x, y));
        const Places places{[&](glm::vec2 u) { return sampler.at(u); }, sampler.at(glm::vec2(0.5f))};
        rays[t] += f(i, places, addressOf(run.seed, std::uint32_t(x0 + x), std::uint32_t(y0 + y)));
      }
    });
    return std::accumulate(rays.begin(), rays.end(), std::uint64_t(0));
  };
  const auto cast = [&](std::span<const std::uint32_t> wanted, double from, double to) {
    return forTexels(
        run.part(from, to), [&](std::size_t i) { return wanted[i] > sums[i].rays; },
        [&](std::size_t i, const Places& places, std::uint64_t address) {
          glm::vec3* open = bent.empty() ? nullptr : &bent[i];
          if (open && sums[i].rays == 0) *open = kNextToNothing * glm::vec3(places.middle->normal);
          return hemisphere.cast(address, wanted[i], places, sums[i], open);
        });
  };
  Openness out = castInRounds(options, sums, poolOf, pools, cast);
  out.buried.assign(n, 0);
  out.rays += forTexels(
      run.part(1.0, 1.0), [&](std::size_t i) { return isDarkBesideOpen(sums, chart, texels.width(), i); },
      [&](std::size_t i, const Places& places, std::uint64_t address) {
        std::uint32_t rays = 0;
        out.buried[i] = hemisphere.buried(*places.middle, address, rays);
        return rays;
      });
  for (std::size_t i = 0; i < n; ++i) {
    out.buried[i] |= sums[i].middle == Sums::Middle::Buried;
    if (out.buried[i] != 0) out.cosine[i] = out.uniform[i] = out.error[i] = 0.0f;
  }
  out.bent = std::move(bent);
  unitAll(out.bent);
  return out;
}

std::vector<float> withoutRims(const Openness& openness, std::span<const std::uint32_t> chart, int width) {
  std::vector<float> out = openness.cosine;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (openness.buried[i] == 0) continue;
    double sum = 0.0, beside = 0.0;
    forNeighbours(chart, width, i, [&](std::size_t j) {
      if (openness.buried[j] != 0 || openness.uniform[j] <= 0.0f) return;
      sum += double(openness.cosine[j]);
      beside += 1.0;
    });
    if (beside > 0.0) out[i] = float(sum / beside);
  }
  return out;
}

}  // namespace lmc::ao
