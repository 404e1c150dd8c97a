#include "libradiosity/rims.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "libscene/burial.h"
#include "libscene/neighbours.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"
#include "libscene/sampling.h"

namespace lmc {

namespace {

constexpr std::uint32_t kFirstPlaces = 4, kFewPlaces = 16;
constexpr double kDarker = 0.95;                         // than its brightest neighbour: what four places may miss of a solid takes no more
constexpr std::uint8_t kMostlyFree = kBurialPlaces / 2;  // for a texel's own light to tell: the share is off by a thirtieth of itself then

class BurialProbe {
 public:
  BurialProbe(const Scene& scene, const TexelTile& tile, int x, int y, const Tracer& tracer, std::uint64_t seed)
      : tracer_(tracer),
        sampler_(scene, tile, tile.at(x, y)),
        numbers_(sequence(seed, Draw::Burial, 0, 0, std::uint32_t(tile.x0 + x), std::uint32_t(tile.y0 + y), 0)) {}

  /// `dark`: whether a neighbour is brighter; else four places tell where they agree.
  std::uint8_t free(bool dark) {
    const std::uint32_t first = freeOf(0, kFirstPlaces);
    if (first == 0) return 0;
    if (first == kFirstPlaces && !dark) return kBurialPlaces;
    const std::uint32_t few = first + freeOf(kFirstPlaces, kFewPlaces);
    return few == kFewPlaces ? kBurialPlaces : std::uint8_t(few + freeOf(kFewPlaces, kBurialPlaces));
  }

 private:
  std::uint32_t freeOf(std::uint32_t from, std::uint32_t until) {
    std::uint32_t free = 0;
    for (std::uint32_t k = from; k < until; ++k) free += isFree(k);
    return free;
  }

  /// One ray tells of most places that they are free; and of the others that they are not, once one of them is found to be buried.
  bool isFree(std::uint32_t k) {
    const SurfacePoint p = sampler_.at(numbers_.point2(k));
    const glm::vec3 from = tracer_.lifted(p.position_m, p.geometricNormal);
    const glm::dmat3 frame = frameAbout(p.geometricNormal);
    // The rays of a place are well spread as a row of points; first ones at a stride of their number would all go one way.
    const auto ray = [&](std::uint32_t r) {
      const glm::vec4 u = numbers_.point(k * kLieRays + r);
      return Ray{from, glm::vec3(frame * cosineHemisphere({u.z, u.w})), INFINITY};
    };
    if (!tracer_.isInsideOfSolid(tracer_.closest(ray(k % kLieRays), Purpose::Exposure))) return true;
    if (inSolid_) return false;
    std::array<Ray, kLieRays> rays;
    for (std::uint32_t r = 0; r < kLieRays; ++r) rays[r] = ray(r);
    inSolid_ = lieOf(tracer_, rays, Purpose::Exposure) == Lie::Buried;
    return !inSolid_;
  }

  const Tracer& tracer_;
  const TexelSampler sampler_;
  const Sobol4 numbers_;
  bool inSolid_ = false;  // some place is
};

double brightness(const glm::dvec3& e) { return e.x + e.y + e.z; }

double brightness(const LightMapValues& values, std::size_t i) {
  return brightness(glm::dvec3(values.direct[i]) + glm::dvec3(values.indirect[i]));
}

double mostBeside(const LightMapValues& values, const LightMap& map, std::size_t i) {
  double most = 0.0;
  for (const std::size_t j : ringOf(map.chart, map.width, i))
    if (j != kNoTexel) most = std::max(most, brightness(values, j));
  return most;
}

struct Value {
  glm::dvec3 direct{0.0}, indirect{0.0}, error{0.0};
  glm::dvec3 light() const { return direct + indirect; }
};

Value valueOf(const LightMapValues& v, std::size_t i) {
  return {glm::dvec3(v.direct[i]), glm::dvec3(v.indirect[i]), glm::dvec3(v.error[i])};
}

/// Free neighbours of a texel that touch each other.
struct Group {
  Value mean;  ///< of `count` of them
  int count = 0;
};

struct Around {
  std::array<Group, 4> groups;  // at most: each ends at a neighbour that is none of them
  std::size_t count = 0;
  Value most;  ///< of each channel

  /// Those with `least` free places are free enough.
  Around(const LightMapValues& values, const std::array<std::size_t, 8>& ring, std::span<const std::uint8_t> free, std::uint8_t least) {
    const auto isFree = [&](std::size_t k) { return ring[k] != kNoTexel && free[ring[k]] >= least; };
    std::size_t first = 0;  // behind a gap, so that no group is met in two parts
    while (first < ring.size() && isFree((first + ring.size() - 1) % ring.size())) ++first;
    bool within = false;
    for (std::size_t step = 0; step < ring.size(); ++step) {
      const std::size_t k = (first + step) % ring.size();
      if (isFree(k)) {
        if (!within) ++count;
        add(groups[count - 1], valueOf(values, ring[k]));
      }
      within = isFree(k);
    }
    for (std::size_t g = 0; g < count; ++g) {
      Value& m = groups[g].mean;
      const double n = groups[g].count;
      m = {m.direct / n, m.indirect / n, m.error / n};
    }
  }

  const Value& darkest() const {
    return std::ranges::min_element(groups.begin(), groups.begin() + std::ptrdiff_t(count), {},
                                    [](const Group& g) { return brightness(g.mean.light()); })
        ->mean;
  }

 private:
  void add(Group& g, const Value& v) {
    ++g.count;
    g.mean.direct += v.direct;
    g.mean.indirect += v.indirect;
    g.mean.error += v.error;
    most.direct = glm::max(most.direct, v.direct);
    most.indirect = glm::max(most.indirect, v.indirect);
  }
};

/// The light of what is free of a texel that is mostly free.
Value aloneOf(const Value& own, double freeShare, const Around& around) {
  const auto alone = [&](const glm::dvec3& e, const glm::dvec3& most) { return glm::min(e / freeShare, glm::max(e, most)); };
  return {alone(own.direct, around.most.direct), alone(own.indirect, around.most.indirect), own.error / freeShare};
}

}  // namespace

TexelArray<std::uint8_t> freePlaces(const LightMapValues& values, const LightMap& map, const Scene& scene, const TexelMap& texels,
                                    const Tracer& tracer, const Run& run) {
  TexelArray<std::uint8_t> out(map.size());
  parallelFor(run, texels.tileCount(), 1, [&](std::size_t t) {
    const auto held = texels.held(t);
    for (std::uint32_t k = 0; k < kTile * kTile; ++k) {
      const auto [x, y] = alongMorton(k);
      if (x >= held->width || y >= held->height) continue;
      const std::size_t i = map.index(*held, x, y);
      if (map.chart[i] == kNone) continue;
      const double own = brightness(values, i), most = mostBeside(values, map, i);
      if (own > 0.0 || most > 0.0) out[i] = BurialProbe(scene, *held, x, y, tracer, run.seed).free(own < kDarker * most);
    }
  });
  return out;
}

RimResult fillRims(LightMapValues& values, const LightMap& map, std::span<const std::uint8_t> free) {
  RimResult out;
  double squares = 0.0, covered = 0.0;
  const auto put = [&](std::size_t i, const Value& to) {
    const glm::dvec3 move = glm::abs(to.light() - valueOf(values, i).light());
    values.direct[i] = Rgb(to.direct);
    values.indirect[i] = Rgb(to.indirect);
    values.error[i] = Rgb(to.error);
    out.texels += move != glm::dvec3(0.0);
    out.largestMove_lx = std::max({out.largestMove_lx, move.x, move.y, move.z});
    squares += glm::dot(move, move);
  };
  // Neither pass reads what it writes: the order of texels says nothing.
  for (std::size_t i = 0; i < map.size(); ++i) {
    if (map.chart[i] == kNone) continue;
    covered += 1.0;
    if (free[i] < kMostlyFree || free[i] == kBurialPlaces) continue;
    const Around around(values, ringOf(map.chart, map.width, i), free, kBurialPlaces);
    if (around.count == 1) put(i, aloneOf(valueOf(values, i), double(free[i]) / kBurialPlaces, around));
    if (around.count > 1) put(i, around.darkest());
  }
  for (std::size_t i = 0; i < map.size(); ++i) {
    if (map.chart[i] == kNone || free[i] >= kMostlyFree) continue;
    const Around around(values, ringOf(map.chart, map.width, i), free, kMostlyFree);
    if (around.count > 0) put(i, around.darkest());
  }
  if (covered > 0.0) out.rmsMove_lx = std::sqrt(squares / (3.0 * covered));
  return out;
}

}  // namespace lmc
