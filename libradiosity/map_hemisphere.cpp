#include <algorithm>
#include <cmath>
#include <numeric>
#include <unordered_map>

#include "libradiosity/light_map.h"
#include "libradiosity/map_cells.h"
#include "libradiosity/pools.h"
#include "libscene/constants.h"
#include "libscene/journal.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"

namespace lmc {

namespace {

constexpr std::uint32_t kFirstRays = 8;     // each half, at the corners of the first cells: how much light varies there
constexpr std::uint32_t kPilotRays = 32;    // of a pilot, at most: enough to meet what is rare
constexpr std::uint32_t kSecondPilot = 16;  // at corners that halving adds, at least, unless the pilot took fewer
// Rays each half, mean over a map, at a goal of 2 %; with goal^-1.4 at others. Three times what the hardest benchmark takes: a level whose
// light hangs on places that hemisphere rays hardly ever find would else take any time; it then states its larger error.
constexpr double kMeanRaysAtTwoPercent = 1024.0;
constexpr double kBudget = 0.95;       // of the goal: what is foretold wavers
constexpr double kObjectBudget = 0.9;  // of an object's: estimates of small ones waver more
// Of a budget: what the bounds of patches and of interpolation take in most levels. The first rays tell neither, for their noise is in
// both.
constexpr double kUsualField = 0.12, kUsualBetween = 0.15;
constexpr double kLeastNoise = 0.4;          // of the goal: below it rays no longer pay
constexpr double kInterpolationShare = 0.2;  // of an error allowed, for what lies between gathered texels
// The same for a cell that was halved just now. What bends gently is worth no more points, each of which would need rays of its own:
// between few their noise is smoothed.
constexpr double kStepShare = 0.6;
constexpr double kSignificant = 3.0, kDoubtful = 1.0;  // bends against noise: mostly; where an object's share for interpolation is used up
// Where light changes by so much from end to end of a cell, that its middle lies between them proves little: towards a corner it rises and
// falls. What so hides goes with the change, and what may be overlooked with the goal.
constexpr double kSteep = 0.35, kLeastSteep = 0.15, kSteepOfGoal = 10.0;
constexpr double kLargeInterpolation = 0.25;  // of an object's budget
constexpr double kLocalLimit = 1.0;  // times the goal: noise of any neighbourhood against max(its own mean, kDimPlace * the level's)
constexpr double kDimPlace = 0.03;
constexpr double kLargeChart = 0.01;   // of the level's texels
constexpr double kLeastBlocks = 24.0;  // of a sample
constexpr std::size_t kProbes = 4;     // of a block of cells, before a sample is drawn
// Rays go with a power above one of a noise, and the strictest of several limits counts: the fewer blocks tell of it, the more they ask for
// (measured, 1.25 times among 40 blocks and 1.0 among 500).
constexpr double kAskedByFew = 8.0;
constexpr double kUnseen = 0.25;  // of the mean: what may be hard where a sample's first rays saw nothing
// A point whose own halves are so many goals off, against its light, has met what is rare and bright, and would show as a speckle: it gets
// so many times its rays.
constexpr double kSpeckle = 10.0;
constexpr std::uint32_t kSpeckleRays = 4;
constexpr int kGuideBlock = 16;                                        // texels
constexpr double kTouchingShare = 1.0 / 32.0, kNearShare = 1.0 / 8.0;  // of a texel's rays, for its class
constexpr int kHalvings = 4;                                           // of a cell of kWidest texels
constexpr int kMaxCorrections = 2, kSpeckleRounds = 3;

double mean3(const glm::dvec3& v) { return (v.x + v.y + v.z) / 3.0; }

/// The state of one hemisphere stage.
class HemisphereBaker {
 public:
  HemisphereBaker(LightMap& map, const Scene& scene, const TexelMap& texels, const Tracer& tracer, const Gather& gather,
                  const MapOptions& options, const Run& run)
      : map_(map),
        scene_(scene),
        texels_(texels),
        tracer_(tracer),
        gather_(gather),
        options_(options),
        goal_(options.goal),
        run_(run),
        cells_({map.width, map.height, map.chart.data()}, scene, texels, tracer, options.interpolate, run),
        wanted_(map.size()) {
    for (std::size_t h = 0; h < 2; ++h) {
      map.bounced[h].assign(map.size(), Rgb(0.0f));
      map.sky[h].assign(map.size(), 0.0f);
    }
    map.coarse.assign(map.size(), Rgb(0.0f));
    map.near.assign(map.size(), 0);
    // Of the whole map: a small chart of which a sample has a block is none the larger for it.
    std::vector<double> texelsOf;
    double all = 0.0;
    for (const std::uint32_t c : map.chart) {
      if (c == kNone) continue;
      if (c >= texelsOf.size()) texelsOf.resize(c + 1, 0.0);
      texelsOf[c] += 1.0;
      all += 1.0;
    }
    for (const double n : texelsOf) large_.push_back(n >= kLargeChart * all);
    // A guide serves the texels of a chart in a block, which lies in one tile: one thread at a time writes to it, in a fixed order.
    static_assert(kTile % kGuideBlock == 0);
    guideOf_ = TexelArray<std::uint32_t>(map.size());
    const std::uint32_t guides = numberChartBlocks(map.chart, map.width, kGuideBlock, guideOf_);
    guides_ = TexelArray<Guide>(guides);  // a guide that knows nothing is all zeros
    directNoise2_.assign(scene.objects.size(), 0.0);
    for (std::size_t i = 0; i < map.size(); ++i) {
      if (map.chart[i] == kNone) continue;
      const glm::dvec3 d = 0.5 * (glm::dvec3(map.direct[0][i]) - glm::dvec3(map.direct[1][i]));
      directNoise2_[map.object[i]] += mean3(d * d);
    }
    if (options_.sampled < 1.0) drawSample();
  }

  void bake() {
    if (options_.rays > 0) return bakeByCount();
    double done = pilot();
    for (int correction = 0; correction <= kMaxCorrections; ++correction) {
      giveOut();
      const double next = correction == 0 ? 0.85 : 0.5 * (1.0 + done);
      if (!cast(done, next)) break;
      done = next;
      early_ = false;
      makePools();
      if (correction == kMaxCorrections) break;
      // As far down as it goes: rays show steps that the pilot's noise hid, and half of a step's cell still has all of it.
      for (int k = 0; k < kHalvings && refine(k == 0 ? kInterpolationShare : kStepShare); ++k) {
        cast(done, 0.5 * (next + 1.0));
        done = 0.5 * (next + 1.0);
        makePools();
      }
    }
    for (int k = 0; k < kSpeckleRounds; ++k) {
      askAgain();
      if (!cast(done, done)) break;
      makePools();
    }
    goBeyond();
    finish();
    run_.progress(1.0);
  }

  /// What the map would have got, when this one is a sample of it.
  HemisphereForecast forecast() const {
    HemisphereForecast out = probes_;
    out.cast_s = spent_.seconds();
    const auto rays = cells_.estimate([this](std::size_t i) { return 2.0 * map_.rays[i]; });
    const double excess = 1.0 + kAskedByFew / rays.blocks;
    out.rays = rays.sum / excess;
    out.standardError = rays.standardError / excess;
    for (const std::uint32_t n : map_.rays) out.cast += 2.0 * n;
    out.near = cells_.estimate([this](std::size_t i) { return double(near_[i].rays); }).sum;
    out.nearLight.resize(scene_.objects.size() + 1);
    for (std::size_t i = 0; i < near_.size(); ++i) {
      out.nearCast += double(near_[i].rays);
      if (poolOf_[i] == kNone) continue;
      const double e = double(strength(near_[i].light)) / (2.0 * map_.rays[i]), own = cells_.standsFor(i);
      for (auto* sum : {&out.nearLight[map_.object[i]], &out.nearLight.back()}) {
        sum->texels += own;
        sum->mean += own * e;
        sum->mean2 += own * e * e;
      }
    }
    for (auto& n : out.nearLight) {
      n.mean /= std::max(1e-9, n.texels);
      n.mean2 /= std::max(1e-9, n.texels);
    }
    return out;
  }

 private:
  /// Of a map that is to be foretold, blocks of cells: those that a few rays show to be hard with a better chance.
  void drawSample() {
    near_ = TexelArray<Near>(map_.size());
    const std::vector<MapCells::Block> blocks = cells_.blocks(kProbes);
    const auto forProbes = [&](const auto& f) {
      for (const MapCells::Block& b : blocks)
        for (const std::size_t i : b.probes) f(i, b);
    };
    // Rays that the sample does not cast again: those that happened to meet much would count twice.
    forProbes([&](std::size_t i, const MapCells::Block&) {
      map_.rays[i] = Pool::kMostRays;
      wanted_[i] = Pool::kMostRays + kFirstRays;
    });
    cast(0.0, 0.02);
    forProbes([&](std::size_t i, const MapCells::Block&) { map_.rays[i] = kFirstRays; });
    // What an error counts against: the level, objects, large charts.
    struct Sum {
      double light = 0.0, texels = 0.0;
      double mean() const { return texels > 0.0 ? light / texels : 0.0; }
    };
    Sum level;
    std::vector<Sum> objects(scene_.objects.size()), charts(large_.size());
    forProbes([&](std::size_t i, const MapCells::Block& b) {
      for (Sum* s : {&level, &objects[map_.object[i]], &charts[map_.chart[i]]}) {
        const double texels = b.texels / double(b.probes.size());
        s->light += texels * mean3(direct(i) + illuminance(i));
        s->texels += texels;
      }
    });
    std::vector<double> sizes;
    double all = 0.0, points = 0.0;
    for (const MapCells::Block& b : blocks) {
      double size = 0.0;
      for (const std::size_t i : b.probes) {
        double against = std::min(level.mean(), kObjectLimit * std::max(objects[map_.object[i]].mean(), kDimRoom * level.mean()));
        if (large_[map_.chart[i]])
          against = std::min(against, kLocalLimit * std::max(charts[map_.chart[i]].mean(), kDimPlace * level.mean()));
        const glm::dvec3 d = 0.5 * (half(i, 0) - half(i, 1));
        if (against > 0.0) size += std::pow(mean3(d * d) / (against * against), kRaysOfVariance) / double(b.probes.size());
      }
      sizes.push_back(size);
      all += b.points * size;
      points += b.points;
    }
    // A few rays may have met nothing where much is to be met. Those that are hard take longer: the least spread for the time that it takes
    // is had with the root.
    for (std::size_t k = 0; k < blocks.size(); ++k)
      sizes[k] = std::sqrt(blocks[k].points * (all > 0.0 ? sizes[k] * points / all + kUnseen : 1.0));
    forProbes([&](std::size_t i, const MapCells::Block&) {
      if (map_.rays[i] == 0) return;  // of two blocks
      probes_.cast += 2.0 * kFirstRays;
      probes_.nearCast += double(near_[i].rays);
      for (std::size_t h = 0; h < 2; ++h) {
        map_.bounced[h][i] = Rgb(0.0f);
        map_.sky[h][i] = 0.0f;
      }
      map_.coarse[i] = Rgb(0.0f);
      map_.near[i] = 0;
      near_[i] = {};
      map_.rays[i] = wanted_[i] = 0;
    });
    guides_ = TexelArray<Guide>(guides_.size());
    cells_.sample(blocks, sizes, std::max(kLeastBlocks, options_.sampled * double(blocks.size())), map_.chart);
  }

  /// Rays that tell how hard each neighbourhood is, and cells halved where light bends; the share of the work that this is.
  double pilot() {
    double done = 0.1;
    wish(kFirstRays);
    cast(0.0, 0.5 * done);
    makePools();
    pilotRays_ = pilotRays();
    wish(pilotRays_);
    if (cast(0.5 * done, done)) makePools();
    // What the others would find is not known to a sample.
    if (options_.sampled == 1.0 && isMet()) return done;
    for (int k = 0; k < kHalvings && refine(); ++k) {
      cast(done, done + 0.02);
      done += 0.02;
      makePools();
    }
    return done;
  }

  /// Rounds towards smaller and smaller errors.
  void goBeyond() {
    if (!options_.goOn && options_.rounds == 0) return;
    for (int round = 1; round <= kMostRounds; ++round) {
      goal_ *= kRoundStep;
      giveOut();
      std::uint64_t rays = 0;
      for (std::size_t i = 0; i < wanted_.size(); ++i) rays += 2ull * (wanted_[i] > map_.rays[i] ? wanted_[i] - map_.rays[i] : 0);
      if (options_.goOn ? !options_.goOn(goal_, rays) : round > options_.rounds) return;
      map_.rounds = round;
      if (cast(0.99, 0.99)) makePools();
      if (!refine()) continue;
      cast(0.99, 0.99);
      makePools();
    }
  }

  /// So many rays for every gathered texel, whatever the goal.
  void bakeByCount() {
    wish(options_.rays);
    cast(0.0, 0.5);
    makePools();
    double done = 0.5;
    for (int k = 0; k < kHalvings && refine(); ++k) {
      cast(done, done + 0.1);
      done += 0.1;
      makePools();
    }
    finish();
    run_.progress(1.0);
  }

  // While rays are cast, bounced, sky and coarse of the map are sums over rays (coarse: of both halves).
  glm::dvec3 half(std::size_t i, std::size_t h) const {
    const double n = map_.rays[i];
    return (kPi * glm::dvec3(scene_.sky) * double(map_.sky[h][i]) + glm::dvec3(map_.bounced[h][i])) / n;
  }
  glm::dvec3 illuminance(std::size_t i) const { return 0.5 * (half(i, 0) + half(i, 1)); }
  glm::dvec3 direct(std::size_t i) const { return 0.5 * (glm::dvec3(map_.direct[0][i]) + glm::dvec3(map_.direct[1][i])); }
  MapCells::ValueAt valueAt() const {
    return [this](std::size_t i) { return MapCells::Value{illuminance(i), varianceOf(i)}; };
  }
  glm::dvec3 bouncedOf(std::size_t i) const {
    return 0.5 * (glm::dvec3(map_.bounced[0][i]) + glm::dvec3(map_.bounced[1][i])) / double(map_.rays[i]);
  }
  double varianceOf(std::size_t i) const { return pools_[poolOf_[i]].variance1 * std::pow(double(map_.rays[i]), -2.0 * kSobolExponent); }

  /// Every gathered texel wants at least so many rays each half.
  void wish(std::uint32_t rays) {
    for (std::size_t i = 0; i < wanted_.size(); ++i)
      if (cells_.gathered(i)) wanted_[i] = std::max(wanted_[i], rays);
  }

  /// Casts what is wanted; false when nothing is.
  bool cast(double from, double to) {
    bool any = false;
    for (std::size_t i = 0; i < wanted_.size() && !any; ++i) any = wanted_[i] > map_.rays[i];
    if (!any) return false;
    parallelFor(run_.part(from, to), texels_.tileCount(), 1, [&](std::size_t t) {
      const auto wanted = [this](std::size_t i) { return wanted_[i] > map_.rays[i]; };
      const std::vector<std::size_t> asked = run_.journal ? texels_.texelsOf(t, wanted) : std::vector<std::size_t>();
      if (run_.journal && asked.empty()) return;
      DirectLight::Tally cast(gather_.direct());
      Journaled kept(run_, tracer_, {Loop::Hemisphere, round_, std::uint32_t(t)}, [&](auto& a) { keep(asked, cast.rays, a); });
      if (kept.taken()) return gather_.direct().countAsCast(cast.rays);
      double before_s = 0.0;
      const int x0 = int(t % std::size_t(texels_.tilesX())) * kTile, y0 = int(t / std::size_t(texels_.tilesX())) * kTile;
      std::shared_ptr<const TexelTile> tile;
      for (std::uint32_t k = 0; k < kTile * kTile; ++k) {
        const auto [x, y] = alongMorton(k);
        if (x0 + x >= map_.width || y0 + y >= map_.height) continue;
        const std::size_t i = std::size_t(y0 + y) * std::size_t(map_.width) + std::size_t(x0 + x);
        const std::uint32_t begin = map_.rays[i], end = wanted_[i];
        if (end <= begin) continue;
        if (!tile) {
          tile = texels_.held(t);
          before_s = threadSeconds();
        }
        for (int h = 0; h < 2; ++h) {
          const Gathered g = gather_.rays(*tile, x, y, h, begin, end, guides_[guideOf_[i]]);
          map_.bounced[std::size_t(h)][i] += Rgb(g.bounced);
          map_.sky[std::size_t(h)][i] += float(g.sky);
          map_.coarse[i] += Rgb(g.coarse);
          if (!near_.empty()) near_[i] = {near_[i].rays + g.near, near_[i].light + Rgb(g.nearLight)};
          if (double(g.touching) > kTouchingShare * (end - begin))
            map_.near[i] = 2;
          else if (double(g.near) > kNearShare * (end - begin))
            map_.near[i] = std::max<std::uint8_t>(map_.near[i], 1);
        }
        map_.rays[i] = end;
      }
      if (tile) spent_.add(before_s);
      kept.put();
    });
    ++round_;
    parallelFor(run_.quiet(), guides_.size(), 16, [&](std::size_t g) { guides_[g].build(); });
    return true;
  }

  /// All that rays of these texels, a tile's, change: sums, what guides are told, and rays to each lamp.
  template <class Archive>
  void keep(std::span<const std::size_t> asked, std::vector<std::uint64_t>& rays, Archive& archive) {
    for (std::uint64_t& n : rays) archive(n);
    std::vector<std::uint32_t> guides;
    for (const std::size_t i : asked) {
      for (std::size_t h = 0; h < 2; ++h) {
        archive(map_.bounced[h][i]);
        archive(map_.sky[h][i]);
      }
      archive(map_.coarse[i]);
      archive(map_.near[i]);
      archive(map_.rays[i]);
      guides.push_back(guideOf_[i]);
    }
    std::ranges::sort(guides);
    guides.erase(std::ranges::unique(guides).begin(), guides.end());
    for (const std::uint32_t g : guides) guides_[g].keep(archive);
  }

  void makePools() {
    // What each gathered texel speaks for: itself, and its weights in others.
    TexelArray<float> spoken(map_.size()), influence(map_.size()), sum(map_.size());
    for (std::size_t i = 0; i < map_.size(); ++i)
      if (cells_.gathered(i)) {
        spoken[i] = influence[i] = float(cells_.standsFor(i));
        sum[i] = spoken[i] * float(mean3(direct(i) + illuminance(i)));
      }
    cells_.forInterpolated([&](std::size_t i, const MapCells::Corners& corners, const MapCells::Weights& weights) {
      const double d = mean3(direct(i));
      for (std::size_t k = 0; k < 4; ++k) {
        const auto w = float(weights[k]), own = float(cells_.standsFor(i));
        spoken[corners[k]] += own * w;
        influence[corners[k]] += own * w * w;
        sum[corners[k]] += own * w * float(d + mean3(illuminance(corners[k])));
      }
    });
    pools_.clear();
    poolOf_.assign(map_.size(), kNone);
    std::unordered_map<std::uint64_t, std::uint32_t> known;
    for (std::size_t i = 0; i < map_.size(); ++i) {
      if (!cells_.gathered(i)) continue;
      // Some 16 points to a pool.
      int spacing = 1;
      while (spacing < 8 && spoken[i] >= 4.0f * float(spacing * spacing)) spacing *= 2;
      const auto x = std::uint64_t(i % std::size_t(map_.width)) / (4 * std::uint64_t(spacing)),
                 y = std::uint64_t(i / std::size_t(map_.width)) / (4 * std::uint64_t(spacing));
      const std::uint64_t key = combine(combine(map_.chart[i], std::uint64_t(spacing)), x << 32 | y);
      const auto [it, fresh] = known.try_emplace(key, std::uint32_t(pools_.size()));
      if (fresh) {
        pools_.emplace_back();
        pools_.back().object = map_.object[i];
        pools_.back().chart = map_.chart[i];
      }
      Pool& p = pools_[it->second];
      poolOf_[i] = it->second;
      const glm::dvec3 d = 0.5 * (half(i, 0) - half(i, 1));
      const double own = cells_.standsFor(i);
      p.points += own;
      p.texels += double(spoken[i]);
      p.rays += own * map_.rays[i];
      // Few rays seldom meet what is rare and bright: those with many have the say.
      p.variance1 += own * mean3(d * d) * std::pow(double(map_.rays[i]), 1.0 + 2.0 * kSobolExponent);
      p.influence += double(influence[i]);
      p.illuminance += double(sum[i]);
      const glm::dvec3 bounced = bouncedOf(i);
      p.bounced += double(spoken[i]) * mean3(bounced);
      p.drift += double(spoken[i]) * (glm::dvec3(map_.coarse[i]) / (2.0 * double(map_.rays[i])) - bounced);
    }
    for (Pool& p : pools_) {
      p.variance1 /= p.rays;
      p.rays /= p.points;
      p.illuminance /= p.texels;
      p.bounced /= p.texels;
      p.drift /= p.texels;
    }
    double sum_ = 0.0, texels = 0.0;
    objectMean_.assign(scene_.objects.size(), 0.0);
    objectTexels_ = objectMean_;
    for (const Pool& p : pools_) {
      sum_ += p.texels * p.illuminance;
      texels += p.texels;
      objectMean_[p.object] += p.texels * p.illuminance;
      objectTexels_[p.object] += p.texels;
    }
    mean_ = texels > 0.0 ? sum_ / texels : 0.0;
    for (std::size_t o = 0; o < objectMean_.size(); ++o)
      if (objectTexels_[o] > 0.0) objectMean_[o] /= objectTexels_[o];
  }

  /// The error that an object may have [lx].
  double budgetOf(std::size_t object) const { return kObjectLimit * goal_ * std::max(objectMean_[object], kDimRoom * mean_); }

  /// Halves cells; false when none needs it. New corners get a pilot's rays.
  bool refine(double share = kInterpolationShare) {
    const std::vector<double> between = interpolation2();
    std::vector<double> significance(between.size());
    for (std::size_t o = 0; o < between.size(); ++o)
      significance[o] =
          std::sqrt(between[o] / std::max(1.0, objectTexels_[o])) > kLargeInterpolation * budgetOf(o) ? kDoubtful : kSignificant;
    const std::size_t added = cells_.refine(valueAt(), [&](std::size_t i) {
      const Pool& p = pools_[poolOf_[i]];
      return MapCells::Tolerance{
          share * std::min({goal_ * mean_, budgetOf(p.object), kLocalLimit * goal_ * std::max(p.illuminance, kDimPlace * mean_)}),
          significance[p.object], std::clamp(kSteepOfGoal * goal_, kLeastSteep, kSteep)};
    });
    wish(options_.rays > 0 ? options_.rays : std::min(kSecondPilot, pilotRays_));
    if (added > 0 && options_.rays == 0) wishAsBeside();
    return added > 0;
  }

  /// New corners lie between gathered texels of a row or a column: a quarter of the rays that those have, for a cell that is halved both
  /// ways shares among four times the points what its corners spoke for.
  void wishAsBeside() {
    const auto w = std::ptrdiff_t(map_.width);
    const auto along = [&](std::size_t i, std::ptrdiff_t step, std::ptrdiff_t room) {
      for (std::ptrdiff_t k = 1; k <= std::min<std::ptrdiff_t>(room, MapCells::kWidest); ++k) {
        const auto n = std::size_t(std::ptrdiff_t(i) + k * step);
        if (map_.chart[n] != map_.chart[i]) break;
        if (map_.rays[n] > 0) return map_.rays[n];
      }
      return 0u;
    };
    for (std::size_t i = 0; i < wanted_.size(); ++i) {
      if (!cells_.gathered(i) || map_.rays[i] > 0) continue;
      const std::ptrdiff_t x = std::ptrdiff_t(i) % w, y = std::ptrdiff_t(i) / w;
      const std::uint32_t row = std::min(along(i, -1, x), along(i, 1, w - 1 - x)),
                          column = std::min(along(i, -w, y), along(i, w, map_.height - 1 - y));
      wanted_[i] = std::max(wanted_[i], std::max(row, column) / 32 * 8);
    }
  }

  /// What is known of the error of the level or of an object [lx].
  struct Standing {
    double points = 0.0, texels = 0.0;
    double noise2 = 0.0, direct2 = 0.0, field2 = 0.0, bounced = 0.0, between2 = 0.0;  ///< sums over the texels
    double noise() const { return texels > 0.0 ? std::sqrt((noise2 + direct2) / texels) : 0.0; }
    double between() const { return texels > 0.0 ? std::sqrt(between2 / texels) : 0.0; }
  };
  std::vector<Standing> standings() const {
    std::vector<Standing> out(scene_.objects.size() + 1);  // the level last
    const std::vector<double> between = interpolation2();
    for (const Pool& p : pools_)
      for (Standing* s : {&out[p.object], &out.back()}) {
        s->points += p.points;
        s->texels += p.texels;
        s->noise2 += p.noise2At(p.rays);
        s->field2 += p.texels * mean3(p.drift * p.drift);
        s->bounced += p.texels * p.bounced;
      }
    for (std::size_t o = 0; o < between.size(); ++o)
      for (Standing* s : {&out[o], &out.back()}) {
        s->direct2 += directNoise2_[o];
        s->between2 += between[o];
      }
    return out;
  }
  /// What patches and bounces left out take of a bound [lx].
  double patchesOf(const Standing& s, double budget) const {
    if (!(s.texels > 0.0)) return 0.0;
    // A sample's drift is mostly noise, and that of coarser patches than the bake's.
    const double field =
        options_.sampled < 1.0 || early_ ? kUsualField * budget : kFieldBound * kFieldShare * std::sqrt(s.field2 / s.texels);
    return field + options_.tail * s.bounced / s.texels + options_.leftOut * mean_;
  }
  /// The noise that there may be beside what interpolation, patches and bounces left out take: they add up in the bound (design.md section
  /// 5) [lx].
  double noiseFor(const Standing& s, double budget) const {
    const double between = early_ ? std::min(s.between(), kUsualBetween * budget) : s.between();
    return std::max((budget - between - patchesOf(s, budget)) / noise95(s.points), kLeastNoise * budget);
  }

  /// Rays that every corner needs for the goal, from what the first ones tell: a coarse goal asks for few.
  std::uint32_t pilotRays() const {
    Standing level = standings().back();
    level.between2 = 0.0;  // not known yet
    const double allowed = noiseFor(level, kBudget * goal_ * mean_);
    if (!(allowed > 0.0)) return kFirstRays;
    const double wish = double(kFirstRays) * std::pow(level.noise() / allowed, 1.0 / kSobolExponent);
    return std::uint32_t(std::clamp(4.0 * std::ceil(wish / 4.0), double(kFirstRays), double(kPilotRays)));
  }

  /// Whether the pilot does: what its rays tell is below the goal, for each object as well, and interpolation has a small part in it.
  bool isMet() const {
    const std::vector<Standing> all = standings();
    const auto below = [&](const Standing& s, double budget, double goal) {
      return s.noise() * noise95(s.points) + s.between() + patchesOf(s, budget) <= budget && s.between() <= kLargeInterpolation * goal;
    };
    for (std::size_t o = 0; o + 1 < all.size(); ++o)
      if (all[o].texels > 0.0 && !below(all[o], kObjectBudget * budgetOf(o), budgetOf(o))) return false;
    return below(all.back(), kBudget * goal_ * mean_, goal_ * mean_);
  }

  /// Rays for each pool so that the predicted noise of the level meets the goal, and of each object and neighbourhood its own.
  void giveOut() {
    if (!(mean_ > 0.0)) return;
    const std::vector<Standing> known = standings();
    // Noise of direct light is there already; rays cannot mend it, and it leaves them at least half of what is allowed.
    const auto varianceFor = [&](const Standing& s, double budget) {
      const double noise = noiseFor(s, budget);
      return std::max(noise * noise - s.direct2 / std::max(1.0, s.texels), 0.5 * noise * noise);
    };

    std::vector<std::uint32_t> all;
    std::vector<std::vector<std::uint32_t>> byObject(scene_.objects.size()), byChart;
    for (std::uint32_t i = 0; i < pools_.size(); ++i) {
      all.push_back(i);
      byObject[pools_[i].object].push_back(i);
      if (pools_[i].chart >= byChart.size()) byChart.resize(pools_[i].chart + 1);
      byChart[pools_[i].chart].push_back(i);
    }
    for (Pool& p : pools_) p.wanted = p.rays;
    giveRays(pools_, all, varianceFor(known.back(), kBudget * goal_ * mean_));
    for (std::size_t o = 0; o < byObject.size(); ++o)
      if (!byObject[o].empty()) giveRays(pools_, byObject[o], varianceFor(known[o], kObjectBudget * budgetOf(o)));
    for (std::size_t c = 0; c < byChart.size(); ++c) {
      if (byChart[c].empty() || !large_[c]) continue;
      double own = 0.0, count = 0.0;
      for (const std::uint32_t i : byChart[c]) {
        own += pools_[i].texels * pools_[i].illuminance;
        count += pools_[i].texels;
      }
      giveRays(pools_, byChart[c], std::pow(kLocalLimit * goal_ * std::max(own / count, kDimPlace * mean_), 2.0));
    }
    double wanted = 0.0, have = 0.0;
    for (const Pool& p : pools_) {
      wanted += p.points * p.wanted;
      have += p.points * p.rays;
    }
    const double most = std::max(0.0, known.back().texels * kMeanRaysAtTwoPercent * std::pow(0.02 / goal_, 1.0 / kSobolExponent) - have);
    if (wanted - have > most)
      for (Pool& p : pools_) p.wanted = p.rays + (p.wanted - p.rays) * most / (wanted - have);
    for (std::size_t i = 0; i < map_.size(); ++i)
      if (poolOf_[i] != kNone) wanted_[i] = std::max(map_.rays[i], std::uint32_t(std::ceil(pools_[poolOf_[i]].wanted / 8.0)) * 8);
  }

  /// More rays for points that would show as speckles.
  void askAgain() {
    for (std::size_t i = 0; i < map_.size(); ++i) {
      if (poolOf_[i] == kNone) continue;
      const glm::dvec3 d = 0.5 * (half(i, 0) - half(i, 1));
      const double speckle = kSpeckle * goal_ * std::max(mean3(direct(i) + illuminance(i)), kDimPlace * mean_);
      if (mean3(d * d) > speckle * speckle) wanted_[i] = std::clamp(kSpeckleRays * map_.rays[i], map_.rays[i], Pool::kMostRays);
    }
  }

  /// Expected square of the interpolation error, summed over the texels of each object [lx^2].
  std::vector<double> interpolation2() const {
    std::vector<double> last(scene_.objects.size(), 0.0), before = last;
    cells_.forErrors(valueAt(), [&](std::size_t i, double byLast, double byBefore) {
      last[map_.object[i]] += byLast;
      before[map_.object[i]] += byBefore;
    });
    for (std::size_t o = 0; o < last.size(); ++o) last[o] = std::max({last[o], before[o], 0.0});
    return last;
  }

  /// Sums become means, and texels between gathered ones get theirs.
  void finish() {
    map_.variance.assign(map_.size(), Rgb(0.0f));
    std::vector<glm::dvec3> variance1(pools_.size(), glm::dvec3(0.0));
    for (std::size_t i = 0; i < map_.size(); ++i)
      if (poolOf_[i] != kNone) {
        const glm::dvec3 d = 0.5 * (half(i, 0) - half(i, 1));
        const Pool& p = pools_[poolOf_[i]];
        variance1[poolOf_[i]] += d * d * std::pow(double(map_.rays[i]), 1.0 + 2.0 * kSobolExponent) / (p.rays * p.points);
      }
    map_.interpolation2 = interpolation2();
    for (std::size_t i = 0; i < map_.size(); ++i) {
      if (poolOf_[i] == kNone) continue;
      const auto n = float(map_.rays[i]);
      map_.variance[i] = Rgb(variance1[poolOf_[i]] * std::pow(double(n), -2.0 * kSobolExponent));
      for (std::size_t h = 0; h < 2; ++h) {
        map_.bounced[h][i] /= n;
        map_.sky[h][i] /= n;
      }
      map_.coarse[i] /= 2.0f * n;
    }
    cells_.forInterpolated([&](std::size_t i, const MapCells::Corners& corners, const MapCells::Weights& weights) {
      for (std::size_t k = 0; k < 4; ++k) {
        const std::size_t from = corners[k];
        const auto w = float(weights[k]);
        for (std::size_t h = 0; h < 2; ++h) {
          map_.bounced[h][i] += w * map_.bounced[h][from];
          map_.sky[h][i] += w * map_.sky[h][from];
        }
        map_.coarse[i] += w * map_.coarse[from];
        map_.variance[i] += w * w * map_.variance[from];
      }
    });
  }

  LightMap& map_;
  const Scene& scene_;
  const TexelMap& texels_;
  const Tracer& tracer_;
  const Gather& gather_;
  const MapOptions& options_;
  double goal_;
  const Run& run_;
  MapCells cells_;
  std::vector<bool> large_;  // of each chart: whether it has a limit of its own
  TexelArray<Guide> guides_;
  TexelArray<std::uint32_t> guideOf_;  // one a texel
  TexelArray<std::uint32_t> wanted_;   // rays each half
  std::vector<Pool> pools_;
  TexelArray<std::uint32_t> poolOf_;  // one a texel; kNone = not gathered
  struct Near {
    std::uint32_t rays = 0;
    Rgb light{0.0f};  // sum over rays of both halves
  };
  TexelArray<Near> near_;      // one a texel of a sample, else none
  HemisphereForecast probes_;  // what was cast before a sample was drawn
  std::vector<double> objectMean_, objectTexels_;
  std::vector<double> directNoise2_;  // of direct light: sum over the texels of each object [lx^2]
  double mean_ = 0.0;
  bool early_ = true;        // no rays but the first ones are there
  std::uint32_t round_ = 0;  // of casts
  SpentTime spent_;          // in casts
  std::uint32_t pilotRays_ = kPilotRays;
};

}  // namespace

void bakeHemisphere(LightMap& map, const Scene& scene, const TexelMap& texels, const Tracer& tracer, const Gather& gather,
                    const MapOptions& options, const Run& run) {
  HemisphereBaker(map, scene, texels, tracer, gather, options, run).bake();
}

HemisphereForecast foretellHemisphere(LightMap& map, const Scene& scene, const TexelMap& texels, const Tracer& tracer, const Gather& gather,
                                      const MapOptions& options, const std::function<void()>& onCells, const Run& run) {
  HemisphereBaker sample(map, scene, texels, tracer, gather, options, run);
  onCells();
  sample.bake();
  return sample.forecast();
}

}  // namespace lmc
