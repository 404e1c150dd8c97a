#include "libradiosity/light_map.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "libscene/constants.h"
#include "libscene/parallel.h"

namespace lmc {

namespace {

// The lower end of noise against its estimate: at chart ends, in corners and at contacts, there is more of it, and true errors are told
// away from them, because closing seams moves texels there on purpose. In a level of a hundred charts that left a sixth less (two seeds
// apart, all texels and those).
constexpr double kNoiseLow = 0.9;
constexpr int kBlock = 4;  // side of the blocks over which differences of halves are pooled [texels]

double mean3(const glm::dvec3& v) { return (v.x + v.y + v.z) / 3.0; }

/// Texels of a block that belong to one chart.
struct Pool {
  std::uint32_t object = kNone;
  std::uint32_t texels = 0, gathered = 0;
  glm::dvec3 directVariance{0.0};  ///< mean over the texels [lx^2]
  double variance = 0.0;           ///< of E, mean over texels and channels [lx^2]
  double sum = 0.0;                ///< of E, mean over channels, over texels [lx]
  double bounced = 0.0;            ///< the part of it that comes by bounces
  double field2 = 0.0;             ///< square of the mean change from patches of twice the size, channel mean [lx^2]
};

struct TexelValue {
  glm::dvec3 direct, sky, bounced;
  glm::dvec3 total() const { return direct + sky + bounced; }
};

TexelValue valueOf(const LightMap& map, const Scene& scene, std::size_t i) {
  TexelValue v{0.5 * (glm::dvec3(map.direct[0][i]) + glm::dvec3(map.direct[1][i])), glm::dvec3(0.0), glm::dvec3(0.0)};
  if (map.variance.empty()) return v;
  v.sky = kPi * glm::dvec3(scene.sky) * (0.5 * (double(map.sky[0][i]) + double(map.sky[1][i])));
  v.bounced = 0.5 * (glm::dvec3(map.bounced[0][i]) + glm::dvec3(map.bounced[1][i]));
  return v;
}

/// f(pool, its texels) in a fixed order: blocks along the map's rows, charts within in order of sight. One block's pools are held at a
/// time.
template <class F>
void forPools(const LightMap& map, const Scene& scene, const F& f) {
  struct Here {
    std::uint32_t chart;
    Pool pool;
    glm::dvec3 drift{0.0};
    std::vector<std::size_t> texels;
  };
  std::vector<Here> here;
  std::size_t count = 0;  // of them, in this block; those behind keep their memory for others
  const auto add = [&](std::size_t i) {
    std::size_t k = 0;
    while (k < count && here[k].chart != map.chart[i]) ++k;
    if (k == here.size()) here.emplace_back();
    Here& h = here[k];
    if (k == count) {
      ++count;
      h.chart = map.chart[i];
      h.pool = {};
      h.pool.object = map.object[i];
      h.drift = glm::dvec3(0.0);
      h.texels.clear();
    }
    const TexelValue v = valueOf(map, scene, i);
    ++h.pool.texels;
    h.pool.gathered += map.rays[i] > 0;
    const glm::dvec3 d = 0.5 * (glm::dvec3(map.direct[0][i]) - glm::dvec3(map.direct[1][i]));
    h.pool.directVariance += d * d;
    h.pool.sum += mean3(v.total());
    h.pool.bounced += mean3(v.bounced);
    if (!map.variance.empty()) {
      h.pool.variance += mean3(glm::dvec3(map.variance[i]));
      h.drift += glm::dvec3(map.coarse[i]) - v.bounced;
    }
    h.texels.push_back(i);
  };
  for (int by = 0; by < map.height; by += kBlock)
    for (int bx = 0; bx < map.width; bx += kBlock) {
      count = 0;
      for (int y = by; y < std::min(by + kBlock, map.height); ++y)
        for (int x = bx; x < std::min(bx + kBlock, map.width); ++x)
          if (const std::size_t i = std::size_t(y) * std::size_t(map.width) + std::size_t(x); map.chart[i] != kNone) add(i);
      for (std::size_t k = 0; k < count; ++k) {
        Pool& pool = here[k].pool;
        pool.directVariance /= double(pool.texels);
        pool.variance = pool.variance / pool.texels + mean3(pool.directVariance);
        const glm::dvec3 d = here[k].drift / double(pool.texels);
        pool.field2 = mean3(d * d);
        f(pool, std::span<const std::size_t>(here[k].texels));
      }
    }
}

}  // namespace

LightMap startMap(const Scene& scene, const TexelMap& texels, const Run& run) {
  LightMap map;
  map.width = texels.width();
  map.height = texels.height();
  const std::size_t n = std::size_t(map.width) * std::size_t(map.height);
  map.chart.assign(n, kNone);
  map.object = TexelArray<std::uint32_t>(n);
  for (auto& d : map.direct) d = TexelArray<Rgb>(n);
  map.edge = TexelArray<std::uint8_t>(n);
  map.rays = TexelArray<std::uint32_t>(n);
  parallelFor(run, texels.tileCount(), 1, [&](std::size_t t) {
    const auto held = texels.held(t);
    const TexelTile& tile = *held;
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        const Texel& texel = tile.at(x, y);
        if (texel.fragmentCount == 0) continue;
        const std::size_t i = map.index(tile, x, y);
        map.chart[i] = texel.chart;
        map.object[i] = scene.triangleObject[tile.fragments[texel.firstFragment].triangle];
      }
  });
  return map;
}

LightMapValues values(const LightMap& map, const Scene& scene) {
  LightMapValues out;
  for (TexelArray<Rgb>* v : {&out.direct, &out.indirect, &out.error}) *v = TexelArray<Rgb>(map.size());
  forPools(map, scene, [&](const Pool& pool, std::span<const std::size_t> texels) {
    for (const std::size_t i : texels) {
      const TexelValue v = valueOf(map, scene, i);
      out.direct[i] = Rgb(v.direct + v.sky);
      out.indirect[i] = Rgb(v.bounced);
      const glm::dvec3 hemisphere = map.variance.empty() ? glm::dvec3(0.0) : glm::dvec3(map.variance[i]);
      out.error[i] = Rgb(glm::sqrt(pool.directVariance + hemisphere));
    }
  });
  return out;
}

TexelArray<float> statedErrors(const LightMap& map, const Scene& scene) {
  std::vector<double> between(scene.objects.size(), 0.0);  // texels of each object that are interpolated
  for (std::size_t i = 0; i < map.size(); ++i)
    if (map.chart[i] != kNone && map.rays[i] == 0) between[map.object[i]] += 1.0;
  TexelArray<float> out(map.size());
  forPools(map, scene, [&](const Pool& pool, std::span<const std::size_t> texels) {
    for (const std::size_t i : texels) {
      double square = mean3(pool.directVariance) + kFieldShare * kFieldShare * pool.field2;
      if (!map.variance.empty()) square += mean3(glm::dvec3(map.variance[i]));
      if (map.rays[i] == 0 && !map.interpolation2.empty()) square += map.interpolation2[map.object[i]] / between[map.object[i]];
      out[i] = float(std::sqrt(square));
    }
  });
  return out;
}

ErrorLedger ledger(const LightMap& map, const Scene& scene, const Omitted& omitted) {
  struct Sums {
    double texels = 0.0, gathered = 0.0, e = 0.0, bounced = 0.0, variance = 0.0, field2 = 0.0, interpolation2 = 0.0;
    void add(const Pool& p) {
      texels += p.texels;
      gathered += p.gathered;
      e += p.sum;
      bounced += p.bounced;
      variance += p.texels * p.variance;
      field2 += p.texels * p.field2;
    }
    double mean() const { return texels > 0.0 ? e / texels : 0.0; }
    double bouncedMean() const { return texels > 0.0 ? bounced / texels : 0.0; }
    double noise() const { return texels > 0.0 ? std::sqrt(variance / texels) : 0.0; }
    double field() const { return texels > 0.0 ? kFieldShare * std::sqrt(field2 / texels) : 0.0; }
    double interpolation() const { return texels > 0.0 ? std::sqrt(std::max(0.0, interpolation2) / texels) : 0.0; }
    // Without a hemisphere it is direct light alone, where every texel is its own.
    double noiseBound() const { return noise() * noise95(gathered > 0.0 ? gathered : texels); }
  };
  Sums level;
  std::vector<Sums> objects(scene.objects.size());
  forPools(map, scene, [&](const Pool& p, std::span<const std::size_t>) {
    level.add(p);
    objects[p.object].add(p);
  });
  for (std::size_t o = 0; o < map.interpolation2.size(); ++o) {
    level.interpolation2 += map.interpolation2[o];
    objects[o].interpolation2 = map.interpolation2[o];
  }
  ErrorLedger out;
  out.texels = std::uint64_t(level.texels);
  out.gathered = std::uint64_t(level.gathered);
  out.mean = level.mean();
  if (!(out.mean > 0.0)) return out;
  const double bouncedShare = level.bouncedMean() / out.mean;
  out.tail = omitted.tail * bouncedShare;
  out.tailEstimate = omitted.tailEstimate * bouncedShare;
  out.leftOut = omitted.leftOut;
  out.noise = level.noise() / out.mean;
  out.field = level.field() / out.mean;
  out.interpolation = level.interpolation() / out.mean;
  out.estimate = std::sqrt(out.noise * out.noise + out.field * out.field + out.interpolation * out.interpolation) + out.tailEstimate;
  // Field noise shared by many texels is in both halves' difference only in part: the bound takes twice the field's share.
  out.bound95 = level.noiseBound() / out.mean + out.interpolation + kFieldBound * out.field + out.tail + out.leftOut;
  const double noiseLow = kNoiseLow * out.noise * noise5(level.gathered > 0.0 ? level.gathered : level.texels),
               fieldLow = kFieldLow * out.field, betweenLow = kInterpolationLow * out.interpolation;
  out.low = std::sqrt(noiseLow * noiseLow + fieldLow * fieldLow + betweenLow * betweenLow);
  out.high = out.bound95;
  for (std::uint32_t o = 0; o < objects.size(); ++o) {
    if (objects[o].texels == 0.0) continue;
    const double against = std::max(objects[o].mean(), kDimRoom * out.mean);
    const double bound = (objects[o].noiseBound() + objects[o].interpolation() + kFieldBound * objects[o].field() +
                          omitted.tail * objects[o].bouncedMean()) /
                             against +
                         omitted.leftOutObject;
    if (bound > out.worstObject) {
      out.worstObject = bound;
      out.worstObjectId = o;
    }
  }
  return out;
}

}  // namespace lmc
