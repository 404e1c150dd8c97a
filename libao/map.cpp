#include <algorithm>
#include <memory>
#include <numeric>

#include "libao/rounds.h"
#include "libscene/journal.h"
#include "libscene/neighbours.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"

namespace lmc::ao {

namespace {

constexpr int kPoolSide = 4;      // texels
constexpr double kOpen = 0.05;    // beside less, a dark rim would hardly show
constexpr double kDarker = 0.25;  // than the most open neighbour

/// Whether a texel is nearly dark beside one that is not.
bool isDarkBesideOpen(std::span<const Sums> sums, std::span<const std::uint32_t> chart, int width, std::size_t i) {
  if (chart[i] == kNone || sums[i].middle != Lie::Unknown) return false;
  double beside = 0.0;
  for (const std::size_t j : ringOf(chart, width, i))
    if (j != kNoTexel) beside = std::max(beside, sums[j].uniform());
  return beside > kOpen && sums[i].uniform() < kDarker * beside;
}

/// The texels of one map, and rays over their hemispheres.
class MapBaker {
 public:
  MapBaker(const Scene& scene, const TexelMap& texels, std::span<const std::uint32_t> chart, const Tracer& tracer, const Options& options,
           const Run& run)
      : scene_(scene),
        texels_(texels),
        chart_(chart),
        options_(options),
        run_(run),
        tracer_(tracer),
        hemisphere_(tracer, options),
        poolOf_(chart.size()),
        pools_(numberChartBlocks(chart, texels.width(), kPoolSide, poolOf_)) {
    sums_ = TexelArray<Sums>(chart.size());  // all zeros is what a texel without rays has
    bent_ = TexelArray<glm::vec3>(options.bent ? chart.size() : 0);
  }

  Openness bake() {
    Openness out = castInRounds(options_, sums_, poolOf_, pools_, cast());
    out.buried.assign(sums_.size(), 0);
    Run last = run_.part(1.0, 1.0);
    last.journal = nullptr;  // few texels, soon done again
    out.rays += forTexels(
        last, [&](std::size_t i) { return isDarkBesideOpen(sums_, chart_, texels_.width(), i); },
        [&](std::size_t i, const Places& places, std::uint64_t address) {
          std::uint32_t rays = 0;
          out.buried[i] = hemisphere_.lie(*places.middle, address, rays) == Lie::Buried;
          return rays;
        });
    for (std::size_t i = 0; i < sums_.size(); ++i) {
      out.buried[i] |= sums_[i].middle == Lie::Buried;
      if (out.buried[i] != 0) out.cosine[i] = out.uniform[i] = out.error[i] = 0.0f;
    }
    unitAll(bent_);
    out.bent = std::move(bent_);
    return out;
  }

  MapForecast foretell() {
    MapForecast out;
    const CastAll all = cast();
    out.rays = foretellRays(options_, sums_, poolOf_, pools_, [&](std::span<const std::uint32_t> wanted, double from, double to) {
      const std::uint64_t rays = all(wanted, from, to);
      out.cast += double(rays);
      return rays;
    });
    out.cast_s = spent_.seconds();
    return out;
  }

 private:
  /// f(texel, its places, its random numbers' address) gives the rays it cast, for texels that are `wanted`; returns their sum.
  template <class Wanted, class F>
  std::uint64_t forTexels(const Run& part, const Wanted& wanted, const F& f) {
    std::vector<std::uint64_t> rays(texels_.tileCount(), 0);
    parallelFor(part, texels_.tileCount(), 1, [&](std::size_t t) {
      const std::vector<std::size_t> asked = part.journal ? texels_.texelsOf(t, wanted) : std::vector<std::size_t>();
      if (part.journal && asked.empty()) return;
      Journaled kept(part, tracer_, {Loop::Openness, round_, std::uint32_t(t)}, [&](auto& archive) { keep(asked, rays[t], archive); });
      if (kept.taken()) return;
      double before_s = 0.0;
      const int x0 = int(t % std::size_t(texels_.tilesX())) * kTile, y0 = int(t / std::size_t(texels_.tilesX())) * kTile;
      std::shared_ptr<const TexelTile> tile;
      for (std::uint32_t k = 0; k < kTile * kTile; ++k) {
        const auto [x, y] = alongMorton(k);
        if (x0 + x >= texels_.width() || y0 + y >= texels_.height()) continue;
        const std::size_t i = std::size_t(y0 + y) * std::size_t(texels_.width()) + std::size_t(x0 + x);
        if (!wanted(i)) continue;
        if (!tile) {
          tile = texels_.held(t);
          before_s = threadSeconds();
        }
        const TexelSampler sampler(scene_, *tile, tile->at(x, y));
        const Places places{[&](glm::vec2 u) { return sampler.at(u); }, sampler.middle()};
        rays[t] += f(i, places, addressOf(run_.seed, std::uint32_t(x0 + x), std::uint32_t(y0 + y)));
      }
      if (tile) spent_.add(before_s);
      kept.put();
    });
    ++round_;
    return std::accumulate(rays.begin(), rays.end(), std::uint64_t(0));
  }

  /// All that rays of these texels change.
  template <class Archive>
  void keep(std::span<const std::size_t> asked, std::uint64_t& rays, Archive& archive) {
    archive(rays);
    for (const std::size_t i : asked) {
      archive(sums_[i].halves);
      archive(sums_[i].rays);
      archive(sums_[i].middle);
      if (!bent_.empty()) archive(bent_[i]);
    }
  }

  CastAll cast() {
    return [this](std::span<const std::uint32_t> wanted, double from, double to) {
      return forTexels(
          run_.part(from, to), [&](std::size_t i) { return wanted[i] > sums_[i].rays; },
          [&](std::size_t i, const Places& places, std::uint64_t address) {
            glm::vec3* open = bent_.empty() ? nullptr : &bent_[i];
            if (open && sums_[i].rays == 0) *open = kNextToNothing * glm::vec3(places.middle->normal);
            return hemisphere_.cast(address, wanted[i], places, sums_[i], open);
          });
    };
  }

  const Scene& scene_;
  const TexelMap& texels_;
  std::span<const std::uint32_t> chart_;
  const Options& options_;
  const Run& run_;
  const Tracer& tracer_;
  const Hemisphere hemisphere_;
  TexelArray<std::uint32_t> poolOf_;
  std::uint32_t pools_ = 0;
  TexelArray<Sums> sums_;
  TexelArray<glm::vec3> bent_;
  std::uint32_t round_ = 0;  // of casts
  SpentTime spent_;          // in casts
};

}  // namespace

Openness bakeMap(const Scene& scene, const TexelMap& texels, std::span<const std::uint32_t> chart, const Tracer& tracer,
                 const Options& options, const Run& run) {
  return MapBaker(scene, texels, chart, tracer, options, run).bake();
}

MapForecast foretellMap(const Scene& scene, const TexelMap& texels, std::span<const std::uint32_t> chart, const Tracer& tracer,
                        const Options& options, const Run& run) {
  return MapBaker(scene, texels, chart, tracer, options, run).foretell();
}

TexelArray<float> withoutRims(const Openness& openness, std::span<const std::uint32_t> chart, int width) {
  TexelArray<float> out = openness.cosine;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (openness.buried[i] == 0) continue;
    double sum = 0.0, beside = 0.0;
    for (const std::size_t j : ringOf(chart, width, i)) {
      if (j == kNoTexel || openness.buried[j] != 0 || openness.uniform[j] <= 0.0f) continue;
      sum += double(openness.cosine[j]);
      beside += 1.0;
    }
    if (beside > 0.0) out[i] = float(sum / beside);
  }
  return out;
}

}  // namespace lmc::ao
