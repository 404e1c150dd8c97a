#include "libradiosity/light_map.h"

#include <algorithm>
#include <cmath>

#include "libscene/constants.h"
#include "libscene/parallel.h"

namespace lmc {

namespace {

constexpr std::uint32_t kPilotPlaces = 8;  // each half, on every texel that a light may reach
constexpr std::uint32_t kPilotRays = 16;   // each half
constexpr std::uint32_t kMostRays = 4096;  // each half, of one texel
// Rays each half, mean over a map, at a goal of 2 %; with goal^-1.4 at others. Three times what the hardest benchmark takes: a level whose
// light hangs on places that hemisphere rays hardly ever find would else take any time; it then states its larger error.
constexpr double kMeanRaysAtTwoPercent = 1024.0;
constexpr int kBlock = 4;               // side of the blocks over which errors are pooled [texels]; divides kTile
constexpr double kSobolExponent = 0.7;  // error ~ rays^-0.7 behind clutter (measured 0.68..0.72, methods/radiosity.md section 2)
constexpr double kNoiseShare = 0.75;    // of the goal, for sampling; the rest is for patch size and what is left out
constexpr double kDimRoom = 0.01;       // an object's error counts against max(its own mean, this * the level's)
constexpr double kObjectLimit = 3.0;    // times the goal, design.md section 5
constexpr double kFieldShare = 0.5;  // error of size h against the change from 2h to h: 1/3 at second order, 1 at first; see docs/stages.md
constexpr int kMaxCorrections = 2;

/// Places on the edge texels of shadows, each half: their error falls about as n^-0.75 and they are a few percent of a map.
std::uint32_t edgePlaces(double goal) { return goal <= 0.01 ? 128 : goal <= 0.04 ? 64 : 32; }

template <class F>
void forTiles(const TexelMap& map, const Run& run, F&& f) {
  parallelFor(run, map.tileCount(), 1, [&](std::size_t i) { f(map.texels(i)); });
}

std::size_t texelIndex(const LightMap& map, const TexelTile& tile, int x, int y) {
  return std::size_t(tile.y0 + y) * std::size_t(map.width) + std::size_t(tile.x0 + x);
}

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

/// Texels of a block that belong to one chart, and their pooled error. Blocks are numbered along the map's rows; charts within in order of
/// sight.
struct Pool {
  std::uint32_t object = kNone;
  std::uint32_t texels = 0;
  std::uint32_t rays = 0;    ///< each half, cast so far
  double variance = 0.0;     ///< of E, mean over texels and channels [lx^2]
  double sum = 0.0;          ///< of E, mean over channels, over texels [lx]
  double bounced = 0.0;      ///< the part of it that comes by bounces
  double field2 = 0.0;       ///< square of the mean change from patches of twice the size, channel mean [lx^2]
  std::uint32_t wanted = 0;  ///< rays each half after the next round
};

struct TexelEstimate {
  glm::dvec3 direct[2], sky[2], bounced[2], coarse;
  glm::dvec3 total(int h) const { return direct[h] + sky[h] + bounced[h]; }
};

TexelEstimate estimateOf(const LightMap& map, const Scene& scene, std::size_t i) {
  TexelEstimate e{};
  for (int h = 0; h < 2; ++h) {
    const auto k = std::size_t(h);
    e.direct[h] = glm::dvec3(map.direct[k][i]);
    if (map.rays[i] == 0) continue;
    e.sky[h] = kPi * glm::dvec3(scene.sky) * (double(map.sky[k][i]) / map.rays[i]);
    e.bounced[h] = glm::dvec3(map.bounced[k][i]) / double(map.rays[i]);
  }
  if (map.rays[i] > 0) e.coarse = glm::dvec3(map.coarse[i]) / (2.0 * map.rays[i]);
  return e;
}

double mean3(const glm::dvec3& v) { return (v.x + v.y + v.z) / 3.0; }

/// Pools of a map in a fixed order; `of` gives each covered texel's pool.
struct Pools {
  std::vector<Pool> pools;
  std::vector<std::uint32_t> of;
};

Pools poolsOf(const LightMap& map, const Scene& scene) {
  Pools out;
  out.of.assign(map.size(), kNone);
  std::vector<std::pair<std::uint32_t, std::uint32_t>> here;  // chart, pool
  std::vector<glm::dvec3> drift;
  for (int by = 0; by < map.height; by += kBlock)
    for (int bx = 0; bx < map.width; bx += kBlock) {
      here.clear();
      drift.clear();
      const std::size_t firstPool = out.pools.size();
      for (int y = by; y < std::min(by + kBlock, map.height); ++y)
        for (int x = bx; x < std::min(bx + kBlock, map.width); ++x) {
          const std::size_t i = std::size_t(y) * std::size_t(map.width) + std::size_t(x);
          if (map.chart[i] == kNone) continue;
          auto it = std::ranges::find(here, map.chart[i], &std::pair<std::uint32_t, std::uint32_t>::first);
          if (it == here.end()) {
            here.emplace_back(map.chart[i], std::uint32_t(out.pools.size()));
            out.pools.emplace_back();
            out.pools.back().object = map.object[i];
            drift.emplace_back(0.0);
            it = here.end() - 1;
          }
          const TexelEstimate e = estimateOf(map, scene, i);
          const glm::dvec3 d = e.total(0) - e.total(1);
          Pool& pool = out.pools[it->second];
          ++pool.texels;
          pool.rays = std::max(pool.rays, map.rays[i]);
          pool.variance += mean3(d * d) / 4.0;
          pool.sum += mean3(0.5 * (e.total(0) + e.total(1)));
          pool.bounced += mean3(0.5 * (e.bounced[0] + e.bounced[1]));
          drift[it->second - firstPool] += e.coarse - 0.5 * (e.bounced[0] + e.bounced[1]);
          out.of[i] = it->second;
        }
      for (std::size_t p = firstPool; p < out.pools.size(); ++p) {
        Pool& pool = out.pools[p];
        pool.variance /= pool.texels;
        const glm::dvec3 d = drift[p - firstPool] / double(pool.texels);
        pool.field2 = mean3(d * d);
        pool.wanted = pool.rays;
      }
    }
  return out;
}

/// Rays for each pool so that the predicted noise of the level meets the goal, and of each object its own, with the fewest rays: minimal
/// sum N for given sum sigma^2 N^(-2a) has N ~ sigma^(2/(1+2a)) (Lagrange).
void giveOut(std::vector<Pool>& pools, const Scene& scene, double goal) {
  constexpr double a = kSobolExponent;
  const auto raysAt = [&](const Pool& p, double kappa) {
    // sigma of one ray's worth: sigma N^a.
    const double s = std::sqrt(p.variance) * std::pow(double(p.rays), a);
    return std::clamp(kappa * std::pow(s, 2.0 / (1.0 + 2.0 * a)), double(p.rays), double(kMostRays));
  };
  const auto predicted = [&](const Pool& p, double kappa) { return p.variance * std::pow(double(p.rays) / raysAt(p, kappa), 2.0 * a); };
  const auto solve = [&](std::span<const std::uint32_t> ids, double allowedVariance) {
    const auto noise = [&](double kappa) {
      double sum = 0.0, texels = 0.0;
      for (const std::uint32_t i : ids) {
        sum += pools[i].texels * predicted(pools[i], kappa);
        texels += pools[i].texels;
      }
      return sum / texels;
    };
    double lo = 1e-6, hi = 1e12;
    if (noise(lo) <= allowedVariance) return lo;
    for (int step = 0; step < 60; ++step) {
      const double mid = std::sqrt(lo * hi);
      (noise(mid) <= allowedVariance ? hi : lo) = mid;
    }
    return hi;
  };

  std::vector<std::uint32_t> all(pools.size());
  std::vector<std::vector<std::uint32_t>> byObject(scene.objects.size());
  double sum = 0.0, texels = 0.0;
  for (std::uint32_t i = 0; i < pools.size(); ++i) {
    all[i] = i;
    byObject[pools[i].object].push_back(i);
    sum += pools[i].sum;
    texels += pools[i].texels;
  }
  if (all.empty() || !(sum > 0.0)) return;
  const double mean = sum / texels, share = kNoiseShare * goal;
  const double level = solve(all, std::pow(share * mean, 2.0));
  for (const auto& ids : byObject) {
    if (ids.empty()) continue;
    double own = 0.0, count = 0.0;
    for (const std::uint32_t i : ids) {
      own += pools[i].sum;
      count += pools[i].texels;
    }
    const double kappa = std::max(level, solve(ids, std::pow(kObjectLimit * share * std::max(own / count, kDimRoom * mean), 2.0)));
    for (const std::uint32_t i : ids) pools[i].wanted = std::uint32_t(std::ceil(raysAt(pools[i], kappa) / 8.0)) * 8;
  }
  double wanted = 0.0, have = 0.0;
  for (const Pool& p : pools) {
    wanted += double(p.texels) * p.wanted;
    have += double(p.texels) * p.rays;
  }
  const double most = texels * kMeanRaysAtTwoPercent * std::pow(0.02 / goal, 1.0 / a);
  if (wanted <= most) return;
  for (Pool& p : pools) p.wanted = p.rays + std::uint32_t((p.wanted - p.rays) * std::max(0.0, most - have) / (wanted - have) / 8.0) * 8;
}

}  // namespace

LightMap startMap(const Scene& scene, const TexelMap& texels, const Run& run) {
  LightMap map;
  map.width = texels.width();
  map.height = texels.height();
  const std::size_t n = std::size_t(map.width) * std::size_t(map.height);
  map.chart.assign(n, kNone);
  map.object.assign(n, kNone);
  for (auto& d : map.direct) d.assign(n, Rgb(0.0f));
  map.edge.assign(n, 0);
  map.rays.assign(n, 0);
  forTiles(texels, run, [&](const TexelTile& tile) {
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        const Texel& t = tile.at(x, y);
        if (t.fragmentCount == 0) continue;
        const std::size_t i = texelIndex(map, tile, x, y);
        map.chart[i] = t.chart;
        map.object[i] = scene.triangleObject[tile.fragments[t.firstFragment].triangle];
      }
  });
  return map;
}

void bakeDirect(LightMap& map, const Scene& scene, const TexelMap& texels, const DirectLight& direct, const MapOptions& options,
                const Run& run) {
  if (!direct.any()) return;
  forTiles(texels, run, [&](const TexelTile& tile) {
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
        const Texel& t = tile.at(x, y);
        if (t.fragmentCount == 0) continue;
        TexelDirect here = pilot[cell(x, y)];
        // Few places prove little: a texel is taken as plainly lit or dark only when its neighbours on the chart say the same.
        bool settled = here.settled(options.goal);
        for (int dy = -1; dy <= 1 && settled; ++dy)
          for (int dx = -1; dx <= 1 && settled; ++dx) {
            const Texel& other = tile.at(x + dx, y + dy);
            if (other.fragmentCount == 0 || other.chart != t.chart) continue;
            const TexelDirect& there = pilot[cell(x + dx, y + dy)];
            settled = there.half[0].signature == here.half[0].signature && !there.half[0].mixed && !there.half[1].mixed;
          }
        if (!settled) here = directOf(scene, tile, x, y, direct, lights, edgePlaces(options.goal), run.seed);
        const std::size_t i = texelIndex(map, tile, x, y);
        map.edge[i] = !settled;
        for (std::size_t h = 0; h < 2; ++h) map.direct[h][i] = Rgb(here.half[h].illuminance);
      }
  });
}

void bakeHemisphere(LightMap& map, const Scene& scene, const TexelMap& texels, const Gather& gather, const MapOptions& options,
                    const Run& run) {
  for (std::size_t h = 0; h < 2; ++h) {
    map.bounced[h].assign(map.size(), Rgb(0.0f));
    map.sky[h].assign(map.size(), 0.0f);
  }
  map.coarse.assign(map.size(), Rgb(0.0f));

  // One round: every texel gets rays up to what its pool (or, in the pilot, everybody) wants.
  const auto round = [&](const Pools* pools, double from, double to) {
    Run part = run;
    part.onProgress = [&](double share) {
      run.progress(from + (to - from) * share);
      return true;
    };
    forTiles(texels, part, [&](const TexelTile& tile) {
      for (int y = 0; y < tile.height; ++y)
        for (int x = 0; x < tile.width; ++x) {
          if (tile.at(x, y).fragmentCount == 0) continue;
          const std::size_t i = texelIndex(map, tile, x, y);
          const std::uint32_t begin = map.rays[i], end = pools ? pools->pools[pools->of[i]].wanted : kPilotRays;
          if (end <= begin) continue;
          for (int h = 0; h < 2; ++h) {
            const Gathered g = gather.rays(tile, x, y, h, begin, end);
            map.bounced[std::size_t(h)][i] += Rgb(g.bounced);
            map.sky[std::size_t(h)][i] += float(g.sky);
            map.coarse[i] += Rgb(g.coarse);
          }
          map.rays[i] = end;
        }
    });
  };
  const auto raysLeft = [&](const Pools& pools) {
    double sum = 0.0;
    for (const Pool& p : pools.pools) sum += double(p.texels) * (p.wanted - p.rays);
    return sum;
  };

  round(nullptr, 0.0, 0.1);
  double done = 0.1;
  for (int correction = 0; correction <= kMaxCorrections; ++correction) {
    Pools pools = poolsOf(map, scene);
    giveOut(pools.pools, scene, options.goal);
    if (raysLeft(pools) == 0.0) break;
    const double next = correction == 0 ? 0.9 : 0.5 * (1.0 + done);
    round(&pools, done, next);
    done = next;
  }
  run.progress(1.0);
}

LightMapValues values(const LightMap& map, const Scene& scene) {
  LightMapValues out;
  out.direct.assign(map.size(), Rgb(0.0f));
  out.indirect = out.error = out.direct;
  std::vector<glm::dvec3> variance;
  const Pools pools = poolsOf(map, scene);
  variance.assign(pools.pools.size(), glm::dvec3(0.0));
  for (std::size_t i = 0; i < map.size(); ++i) {
    if (map.chart[i] == kNone) continue;
    const TexelEstimate e = estimateOf(map, scene, i);
    out.direct[i] = Rgb(0.5 * (e.direct[0] + e.direct[1] + e.sky[0] + e.sky[1]));
    out.indirect[i] = Rgb(0.5 * (e.bounced[0] + e.bounced[1]));
    const glm::dvec3 d = 0.5 * (e.total(0) - e.total(1));
    variance[pools.of[i]] += d * d / double(pools.pools[pools.of[i]].texels);
  }
  for (std::size_t i = 0; i < map.size(); ++i)
    if (map.chart[i] != kNone) out.error[i] = Rgb(glm::sqrt(variance[pools.of[i]]));
  return out;
}

ErrorLedger ledger(const LightMap& map, const Scene& scene, double tail, double tailEstimate) {
  struct Sums {
    double texels = 0.0, e = 0.0, bounced = 0.0, variance = 0.0, field2 = 0.0, pools = 0.0;
    void add(const Pool& p) {
      texels += p.texels;
      e += p.sum;
      bounced += p.bounced;
      variance += p.texels * p.variance;
      field2 += p.texels * p.field2;
      pools += 1.0;
    }
    double mean() const { return texels > 0.0 ? e / texels : 0.0; }
    double bouncedMean() const { return texels > 0.0 ? bounced / texels : 0.0; }
    double noise() const { return texels > 0.0 ? std::sqrt(variance / texels) : 0.0; }
    double field() const { return texels > 0.0 ? kFieldShare * std::sqrt(field2 / texels) : 0.0; }
    // Pooled variances of p blocks: their sum is about chi-square with p or more degrees of freedom; 1.645 of its relative spread
    // sqrt(2/p).
    double noise95() const { return pools > 0.0 ? noise() * std::sqrt(1.0 + 1.645 * std::sqrt(2.0 / pools)) : 0.0; }
  };
  Sums level;
  std::vector<Sums> objects(scene.objects.size());
  for (const Pool& p : poolsOf(map, scene).pools) {
    level.add(p);
    objects[p.object].add(p);
  }
  ErrorLedger out;
  out.texels = std::uint64_t(level.texels);
  out.mean = level.mean();
  if (!(out.mean > 0.0)) return out;
  const double bouncedShare = level.bouncedMean() / out.mean;
  out.tail = tail * bouncedShare;
  out.tailEstimate = tailEstimate * bouncedShare;
  out.noise = level.noise() / out.mean;
  out.field = level.field() / out.mean;
  out.estimate = std::sqrt(out.noise * out.noise + out.field * out.field) + out.tailEstimate;
  // Field noise shared by many texels is in both halves' difference only in part: the bound takes twice the field's share.
  out.bound95 = level.noise95() / out.mean + 2.0 * out.field + out.tail;
  for (std::uint32_t o = 0; o < objects.size(); ++o) {
    if (objects[o].texels == 0.0) continue;
    const double against = std::max(objects[o].mean(), kDimRoom * out.mean);
    const double bound = (objects[o].noise95() + 2.0 * objects[o].field() + tail * objects[o].bouncedMean()) / against;
    if (bound > out.worstObject) {
      out.worstObject = bound;
      out.worstObjectId = o;
    }
  }
  return out;
}

}  // namespace lmc
