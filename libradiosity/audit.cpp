#include "libradiosity/audit.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "libscene/journal.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"

namespace lmc {

namespace {

constexpr double kContradiction = 2.576;   // standard errors: 99 % two-sided, so that an honest ledger is hardly ever blamed
constexpr double kOneSided = 1.645;        // 95 %
constexpr std::uint32_t kPilotPaths = 16;  // each stream
constexpr std::uint64_t kRaysAPath = 16;   // more than most take: below it there is no pilot
// Noise of the product of two streams goes with 1/(paths x sqrt(texels)), the texels' own spread with 1/sqrt(texels): at a given number of
// rays few texels with many paths are best for the one, many for the other.
constexpr double kRaysRoot = 12.0;
constexpr std::uint32_t kFewestTexels = 24, kMostTexels = 512, kLeastOfClass = 4;
// What is stated may be the very thing that is wrong: such shares of the draws go by the number of texels alone, between classes and
// within.
constexpr double kEvenClasses = 0.5, kEvenShare = 0.5;
constexpr std::size_t kWorst = 8;

double mean3(const glm::dvec3& v) { return (v.x + v.y + v.z) / 3.0; }

/// A texel that was drawn, and what its paths said.
struct Drawn {
  std::size_t texel = 0;
  std::uint32_t kind = 0, number = 0;
  double weight = 0.0;  // texels of the level that it stands for
  glm::dvec3 sums[2]{glm::dvec3(0.0), glm::dvec3(0.0)};
};

/// Draws of each class along the sums of their chances.
std::vector<Drawn> draw(const LightMap& map, std::span<const float> stated, std::uint32_t count, const Run& run, AuditResult& out,
                        double unit) {
  constexpr std::size_t kKinds = kTexelClassNames.size();
  std::array<std::size_t, kKinds> texelsOf{}, last{};
  std::array<double, kKinds> sum{}, squares{};
  for (std::size_t i = 0; i < map.size(); ++i) {
    if (map.chart[i] == kNone) continue;
    const auto k = std::size_t(classOf(map, i));
    ++texelsOf[k];
    last[k] = i;
    sum[k] += double(stated[i]);
    squares[k] += double(stated[i]) * double(stated[i]);
  }
  const double all = std::accumulate(sum.begin(), sum.end(), 0.0);
  double covered = 0.0;
  for (const std::size_t n : texelsOf) covered += double(n);
  std::vector<Drawn> drawn;
  for (std::size_t k = 0; k < kKinds; ++k) {
    const auto texels = double(texelsOf[k]);
    out.classes[k].texels = texelsOf[k];
    if (texelsOf[k] == 0) continue;
    out.classes[k].stated = unit * std::sqrt(squares[k] / texels);
    const double even = texels / covered, share = all > 0.0 ? (1.0 - kEvenClasses) * sum[k] / all + kEvenClasses * even : even;
    const auto n = std::max(kLeastOfClass, std::uint32_t(std::lround(share * double(count))));
    out.classes[k].drawn = n;
    const auto chance = [&](std::size_t i) {
      return (sum[k] > 0.0 ? (1.0 - kEvenShare) * double(stated[i]) / sum[k] + kEvenShare / texels : 1.0 / texels);
    };
    // One draw in each of n equal parts of the sum of chances: even steps would fall in with whatever repeats along a map.
    const std::uint64_t name = combine(combine(run.seed, std::uint64_t(Draw::AuditChoice)), k);
    const auto at = [&](std::uint32_t part) { return (double(part) + double(combine(name, part) >> 11) * 0x1p-53) / double(n); };
    double upTo = 0.0;
    std::uint32_t next = 0;
    for (std::size_t i = 0; i < map.size(); ++i) {
      if (map.chart[i] == kNone || std::size_t(classOf(map, i)) != k) continue;
      upTo += chance(i);
      for (; next < n && at(next) < upTo; ++next)
        drawn.push_back({i, std::uint32_t(k), std::uint32_t(drawn.size()), 1.0 / (double(n) * chance(i))});
    }
    // Rounding may leave the sum of chances below the last step.
    for (; next < n; ++next) drawn.push_back({last[k], std::uint32_t(k), std::uint32_t(drawn.size()), 1.0 / (double(n) * chance(last[k]))});
  }
  return drawn;
}

/// Paths [begin, end) of both streams of every drawn texel; tile by tile, for a tile is made as a whole.
void trace(std::vector<Drawn>& drawn, std::uint32_t begin, std::uint32_t end, const LightMap& map, const Scene& scene,
           const TexelMap& texels, const PathTracer& tracing, const Tracer& tracer, const Run& run) {
  std::vector<std::pair<std::size_t, std::size_t>> byTile;  // tile, drawn
  for (std::size_t d = 0; d < drawn.size(); ++d) {
    const std::size_t x = drawn[d].texel % std::size_t(map.width), y = drawn[d].texel / std::size_t(map.width);
    byTile.emplace_back(y / kTile * std::size_t(texels.tilesX()) + x / kTile, d);
  }
  std::ranges::sort(byTile);
  std::vector<std::size_t> first;
  for (std::size_t k = 0; k < byTile.size(); ++k)
    if (k == 0 || byTile[k].first != byTile[k - 1].first) first.push_back(k);
  first.push_back(byTile.size());
  parallelFor(run, first.size() - 1, 1, [&](std::size_t t) {
    // How many texels and paths there are follows from the rays of the bake, which --memory may change.
    std::uint64_t asked = combine(begin, end);
    for (std::size_t k = first[t]; k < first[t + 1]; ++k)
      asked = combine(combine(asked, drawn[byTile[k].second].number), drawn[byTile[k].second].texel);
    Journaled kept(run, tracer, {Loop::Audit, begin, std::uint32_t(byTile[first[t]].first), asked}, [&](auto& archive) {
      for (std::size_t k = first[t]; k < first[t + 1]; ++k)
        for (glm::dvec3& sum : drawn[byTile[k].second].sums) archive(sum);
    });
    if (kept.taken()) return;
    const TexelTile tile = texels.texels(byTile[first[t]].first);
    for (std::size_t k = first[t]; k < first[t + 1]; ++k) {
      Drawn& d = drawn[byTile[k].second];
      const int x = int(d.texel % std::size_t(map.width)), y = int(d.texel / std::size_t(map.width));
      const TexelSampler sampler(scene, tile, tile.at(x - tile.x0, y - tile.y0));
      for (std::uint64_t stream = 0; stream < 2; ++stream) {
        // A texel may be drawn twice: each time by its own paths.
        std::uint64_t key = combine(combine(run.seed, std::uint64_t(Draw::Audit)), std::uint64_t(d.number) << 1 | stream);
        key = combine(key, std::uint64_t(x) << 32 | std::uint64_t(y));
        d.sums[stream] += tracing.sum(sampler, key, begin, end);
      }
    }
    kept.put();
  });
}

/// Sum over draws of weight * value, as a mean over `texels`, and its standard error: draws of a class stand for it alike.
struct Mean {
  double value = 0.0, error = 0.0;
};
template <class F>
Mean meanOf(std::span<const Drawn> drawn, std::uint32_t kind, double texels, F&& valueOf) {
  double sum = 0.0, squares = 0.0, n = 0.0;
  for (const Drawn& d : drawn) {
    if (d.kind != kind) continue;
    const double v = d.weight * valueOf(d);
    sum += v;
    squares += v * v;
    n += 1.0;
  }
  if (n == 0.0) return {};
  // sum v is the estimate of the total: n draws of n v each, whose mean it is.
  const double spread = n > 1.0 ? std::max(0.0, squares - sum * sum / n) * n / (n - 1.0) : 0.0;
  return {sum / texels, std::sqrt(spread) / texels};
}

}  // namespace

TexelClass classOf(const LightMap& map, std::size_t i) {
  if (map.edge[i]) return TexelClass::Edge;
  if (!map.near.empty() && map.near[i] != 0) return map.near[i] > 1 ? TexelClass::Contact : TexelClass::NearHit;
  return map.rays[i] == 0 && !map.near.empty() ? TexelClass::Interpolated : TexelClass::Smooth;
}

double Found::low(double z) const { return std::max(std::sqrt(std::max(0.0, square - z * squareError)), std::abs(bias) - z * biasError); }
double Found::high(double z) const { return std::sqrt(std::max(square, bias * bias) + z * squareError); }

AuditResult audit(const LightMap& map, const LightMapValues& values, const Scene& scene, const TexelMap& texels, const Tracer& tracer,
                  std::span<const float> stated, const AuditOptions& options, ErrorLedger& ledger, const Run& run) {
  AuditResult out;
  if (!(ledger.mean > 0.0)) return out;
  const double unit = 1.0 / ledger.mean;
  const std::uint64_t before = tracer.rays(Purpose::Audit);
  const auto count = std::clamp(std::uint32_t(std::sqrt(double(options.rays)) / kRaysRoot), kFewestTexels, kMostTexels);
  std::vector<Drawn> drawn = draw(map, stated, count, run, out, unit);
  const PathTracer tracing(scene, tracer, options.paths);
  // What a path takes is known by a few of them; a level in which even these are too much is not audited.
  if (kRaysAPath * 2 * kPilotPaths * drawn.size() > options.rays) return {};
  trace(drawn, 0, kPilotPaths, map, scene, texels, tracing, tracer, run.part(0.0, 0.1));
  const std::uint64_t pilot = tracer.rays(Purpose::Audit) - before;
  const double perPath = double(pilot) / double(kPilotPaths);  // of all texels, both streams
  const double more = perPath > 0.0 && options.rays > pilot ? double(options.rays - pilot) / perPath : 0.0;
  // Paths of later rounds are as long on average; a twentieth is kept for chance.
  const std::uint32_t paths = kPilotPaths + std::uint32_t(std::min(0.95 * more, double(1u << 22)));
  trace(drawn, kPilotPaths, paths, map, scene, texels, tracing, tracer, run.part(0.1, 1.0));
  out.drawn = std::uint32_t(drawn.size());
  out.paths = 2ull * paths * drawn.size();
  out.rays = tracer.rays(Purpose::Audit) - before;

  const double scale = 1.0 / double(paths);
  const auto valueOf = [&](std::size_t i) { return glm::dvec3(values.direct[i] + values.indirect[i]); };
  const auto square = [&](const Drawn& d) {
    const glm::dvec3 v = valueOf(d.texel);
    return unit * unit * mean3((v - scale * d.sums[0]) * (v - scale * d.sums[1]));
  };
  const auto difference = [&](const Drawn& d) { return unit * mean3(valueOf(d.texel) - 0.5 * scale * (d.sums[0] + d.sums[1])); };
  double all = 0.0;
  for (const AuditedClass& c : out.classes) all += double(c.texels);
  for (std::uint32_t k = 0; k < out.classes.size(); ++k) {
    AuditedClass& c = out.classes[k];
    if (c.drawn == 0) continue;
    const Mean s = meanOf(drawn, k, double(c.texels), square), b = meanOf(drawn, k, double(c.texels), difference);
    c.found = {s.value, s.error, b.value, b.error};
    const double share = double(c.texels) / all;
    out.found.square += share * s.value;
    out.found.bias += share * b.value;
    out.found.squareError = std::hypot(out.found.squareError, share * s.error);
    out.found.biasError = std::hypot(out.found.biasError, share * b.error);
  }
  for (const Drawn& d : drawn) {
    const glm::dvec3 v = valueOf(d.texel), a = scale * d.sums[0], b = scale * d.sums[1];
    const glm::dvec3 noise = 0.5 * (a - b);
    out.worst.push_back({d.texel, TexelClass(d.kind), mean3(v), double(stated[d.texel]), std::abs(mean3(v - 0.5 * (a + b))),
                         std::sqrt(mean3(noise * noise))});
  }
  const auto beyond = [](const AuditedTexel& t) { return t.found - 2.0 * t.foundError; };
  std::ranges::stable_sort(out.worst, [&](const AuditedTexel& a, const AuditedTexel& b) { return beyond(a) > beyond(b); });
  // A texel that was drawn twice shows once.
  std::vector<AuditedTexel> shown;
  for (const AuditedTexel& t : out.worst)
    if (shown.size() < kWorst && std::ranges::find(shown, t.texel, &AuditedTexel::texel) == shown.end()) shown.push_back(t);
  out.worst = std::move(shown);

  out.contradicts = out.found.low(kContradiction) > ledger.bound95;
  if (out.contradicts) {
    ledger.estimate = std::max({ledger.estimate, out.found.rms(), std::abs(out.found.bias)});
    ledger.bound95 = std::max(ledger.bound95, out.found.high(kOneSided));
    ledger.high = std::max(ledger.high, ledger.bound95);
  }
  return out;
}

}  // namespace lmc
