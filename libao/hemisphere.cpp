#include "libao/hemisphere.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "libscene/rng.h"
#include "libscene/sampling.h"

namespace lmc::ao {

namespace {

constexpr std::size_t kBlocks = 16;     // of a batch: 256 rays, as many as a stream takes well
constexpr double kOpenBeside = 0.25;    // (1 - 0.25)^16 = 1 %
constexpr double kShows = 0.05;         // openness: less of it is dark with and without a rim
constexpr int kAsked = 2;               // places that see nothing, of a batch, until one is found to be cut off from the middle
constexpr std::uint16_t kAll = 0xffff;  // bits of a block
static_assert(kBlock == RayFan::kRays);

}  // namespace

/// Sixteen rays from one place.
struct Hemisphere::Block {
  const Directions* directions;
  std::uint32_t half;
  glm::mat3 frame;
  glm::vec3 face;                   ///< the geometric normal
  std::uint16_t blocked;            ///< bit i: ray i is, or it goes below the face
  std::array<float, kBlock> share;  ///< how much of each counts where occluders fall off, [0, 1]
  bool dark() const { return blocked == kAll; }
};

/// Blocks of one texel.
struct Hemisphere::Batch {
  std::array<Block, kBlocks> blocks;
  std::array<RayFan, kBlocks> fans;
  std::size_t count = 0;
};

/// What a half of a texel does to the directions: which set, and how far about the normal.
struct Hemisphere::Turn {
  std::uint32_t half, set;
  double cosine, sine;
  glm::dvec3 normal{0.0};
  glm::mat3 frame{1.0f};  ///< about that normal: places of a flat texel share it
  Turn(std::uint64_t address, std::uint32_t h) : half(h) {
    const std::uint64_t choice = combine(address, h);
    const double angle = 2.0 * kPi * double(choice >> 32) * 0x1p-32;
    set = std::uint32_t(choice) % kSets;
    cosine = std::cos(angle);
    sine = std::sin(angle);
  }
  void about(const glm::dvec3& n) {
    const glm::dmat3 plain = frameAbout(n);
    normal = n;
    frame = glm::mat3(glm::dmat3(cosine * plain[0] + sine * plain[1], cosine * plain[1] - sine * plain[0], plain[2]));
  }
};

namespace {

/// A vector register: left to itself the compiler (-fno-tree-slp-vectorize) turns directions number by number.
using Lanes [[gnu::vector_size(16)]] = float;
Lanes lanes(const glm::vec3& v) { return Lanes{v.x, v.y, v.z, 0.0f}; }

/// Points of the unit square that a half's places lie at.
Sobol4 placesOf(std::uint64_t address, std::uint32_t half) { return Sobol4(combine(combine(address, half), 0x91ace)); }

}  // namespace

std::uint64_t addressOf(std::uint64_t seed, std::uint32_t x, std::uint32_t y) {
  return combine(combine(seed, std::uint64_t(Draw::Openness)), (std::uint64_t(x) << 32) | y);
}

void unitAll(std::span<glm::vec3> directions) {
  for (glm::vec3& d : directions)
    if (d != glm::vec3(0.0f)) d = glm::normalize(d);
}

Hemisphere::Hemisphere(const Tracer& tracer, const Options& options) : tracer_(tracer), options_(options) {}

void Hemisphere::start(Batch& batch, const SurfacePoint& place, Turn& turn, std::uint32_t block) const {
  Block& b = batch.blocks[batch.count];
  RayFan& fan = batch.fans[batch.count++];
  // Past the end of a set the next one goes on.
  constexpr std::uint32_t kBlocksOfSet = kRaysOfSet / kBlock;
  const Directions& d = directions((turn.set + block / kBlocksOfSet) % kSets, block % kBlocksOfSet);
  if (turn.normal != place.normal) turn.about(place.normal);
  b.directions = &d;
  b.half = turn.half;
  b.frame = turn.frame;
  b.face = place.geometricNormal;
  const Lanes from = lanes(tracer_.lifted(place.position_m, place.geometricNormal));
  const Lanes x = lanes(turn.frame[0]), y = lanes(turn.frame[1]), z = lanes(turn.frame[2]);
  for (std::size_t i = 0; i < kBlock; ++i) {
    // Each member as it will be read: a register that is filled from parts just written waits for all of them.
    RayFan::OneRay& r = fan.rays[i];
    r.origin_m = std::bit_cast<glm::vec4>(from);
    r.direction = std::bit_cast<glm::vec4>(d.towards[i].x * x + d.towards[i].y * y + d.towards[i].z * z);
    r.tFar = tFar();
    r.mask = ~0u;
    r.id = r.flags = 0u;
  }
  if (place.normal == place.geometricNormal) return;
  for (RayFan::OneRay& r : fan.rays)
    if (glm::dot(glm::vec3(r.direction), b.face) <= 0.0f) r.tFar = -1.0f;
}

/// Returns the rays cast.
std::uint32_t Hemisphere::trace(Batch& batch) const {
  const std::span<RayFan> fans(batch.fans.data(), batch.count);
  if (options_.fallOff == FallOff::None) {
    std::array<std::uint16_t, kBlocks> blocked;
    const std::uint64_t cast = tracer_.occluded(fans, {blocked.data(), batch.count}, Purpose::Occlusion);
    for (std::size_t k = 0; k < batch.count; ++k) batch.blocks[k].blocked = blocked[k];
    return std::uint32_t(cast);
  }
  std::uint32_t cast = 0;
  for (std::size_t k = 0; k < batch.count; ++k) {
    std::array<Ray, kBlock> rays;
    std::array<Hit, kBlock> hits;
    for (std::size_t i = 0; i < kBlock; ++i) rays[i] = fans[k].ray(i, tFar());
    tracer_.closest(rays, hits, Purpose::Occlusion);
    Block& b = batch.blocks[k];
    b.blocked = 0;
    for (std::size_t i = 0; i < kBlock; ++i) {
      const bool below = fans[k].rays[i].tFar < 0.0f;
      const float near = hits[i] ? std::max(0.0f, 1.0f - hits[i].t / tFar()) : 0.0f;
      b.share[i] = below ? 1.0f : options_.fallOff == FallOff::Linear ? near : near * near;
      if (hits[i] || below) b.blocked |= std::uint16_t(1u << i);
      cast += below ? 0 : 1;
    }
  }
  return cast;
}

Hemisphere::Sight Hemisphere::sightOf(const Batch& batch, const Sums& before) {
  // What came before is one place more.
  const bool any = before.halves[0].uniform > 0.0f || before.halves[1].uniform > 0.0f;
  const int places = int(batch.count) + (any ? 1 : 0);
  double open = any ? kBlock * before.uniform() : 0.0;
  int seeing = open > 0.0 ? 1 : 0;
  for (std::size_t k = 0; k < batch.count; ++k) {
    if (batch.blocks[k].dark()) continue;
    open += int(kBlock) - std::popcount(batch.blocks[k].blocked);
    ++seeing;
  }
  if (seeing == 0 || seeing == places) return Sight::Alike;
  if (open > kOpenBeside * kBlock * seeing) return Sight::Parted;
  return open > kShows * kBlock * places ? Sight::Mixed : Sight::Alike;
}

/// How the place of a fan lies.
Lie Hemisphere::lie(const RayFan& fan, std::uint32_t& cast) const {
  std::array<Ray, kLieRays> rays;
  for (std::size_t i = 0; i < kLieRays; ++i) rays[i] = fan.ray(i, std::numeric_limits<float>::infinity());
  cast += kLieRays;
  return lieOf(tracer_, rays, Purpose::Occlusion);
}

/// Whether a surface lies across the way between two places of a texel, just above it (side 1) or just below (-1).
bool Hemisphere::cutOff(const SurfacePoint& from, const Block& b, const RayFan& fan, double side, std::uint32_t& cast) const {
  const glm::vec3 start = tracer_.lifted(from.position_m, side * from.geometricNormal);
  const glm::vec3 end = glm::vec3(fan.rays[0].origin_m) + (float(side) - 1.0f) * tracer_.lift_m() * b.face;
  ++cast;
  return tracer_.occluded(Ray{start, end - start, 1.0f}, Purpose::Occlusion);
}

Lie Hemisphere::lie(const SurfacePoint& place, std::uint64_t address, std::uint32_t& cast) const {
  Batch batch;
  Turn turn(address, 0);
  start(batch, place, turn, 0);
  return lie(batch.fans[0], cast);
}

/// How much of a ray counts as blocked.
float Hemisphere::shareOf(const Block& b, std::size_t i) const {
  if (options_.fallOff != FallOff::None) return b.share[i];
  return (b.blocked & 1u << i) != 0 ? 1.0f : 0.0f;
}

/// The blocked weights of a block; all of them are exactly those that directions() sums up.
Sums::Half Hemisphere::blockedOf(const Block& b) const {
  const Directions& d = *b.directions;
  Sums::Half out;
  if (options_.fallOff != FallOff::None) {
    float shares = 0.0f;
    for (std::size_t i = 0; i < kBlock; ++i) {
      shares += shareOf(b, i);
      out.blockedUniform += shareOf(b, i) * d.uniform[i];
    }
    out.blockedCosine = 2.0f * shares - out.blockedUniform;  // both weights of a ray make 2 together
    return out;
  }
  // Blocked or open ones, whichever are fewer.
  const int blocked = std::popcount(b.blocked);
  const bool mostAre = blocked > int(kBlock) / 2;
  float sum = 0.0f;
  for (unsigned left = mostAre ? b.blocked ^ kAll : b.blocked; left != 0; left &= left - 1)
    sum += d.uniform[std::size_t(std::countr_zero(left))];
  out.blockedUniform = mostAre ? d.allUniform - sum : sum;
  out.blockedCosine = 2.0f * float(blocked) - out.blockedUniform;
  return out;
}

/// Which places of one batch count.
class Hemisphere::Judge {
 public:
  Judge(const Hemisphere& h, const Batch& batch, const Places& places, std::uint64_t address, Sums& sums)
      : h_(h), places_(places), address_(address), sums_(sums), sight_(places.middle ? h.sightOf(batch, sums) : Sight::Alike) {}

  bool counts(const Block& b, const RayFan& fan) {
    if (sight_ == Sight::Alike) return true;
    if (b.dark()) return !(mayBeBuried(b, fan) && middle() != Lie::Buried && h_.lie(fan, cast) == Lie::Buried);
    if (sight_ == Sight::Parted)  // a texel that is curved meets one of the two ways
      return !(middle() == Lie::Closed && cut(b, fan, 1.0) && cut(b, fan, -1.0));
    // One that sees little is asked for all of them: if it is cut off, the middle may be the one that is inside.
    if (!std::exchange(askedOpen_, true) && cut(b, fan, 1.0)) middle();
    return true;
  }

  std::uint32_t cast = 0;  ///< rays

 private:
  /// Of a place that sees nothing.
  bool mayBeBuried(const Block& b, const RayFan& fan) {
    if (sight_ == Sight::Parted) return true;
    if (!foundCut_ && asked_++ >= kAsked) return false;
    const bool is = cut(b, fan, 1.0);
    foundCut_ = foundCut_ || is;
    return is;
  }
  Lie middle() {
    if (sums_.middle == Lie::Unknown) sums_.middle = h_.lie(*places_.middle, address_, cast);
    return sums_.middle;
  }
  bool cut(const Block& b, const RayFan& fan, double side) { return h_.cutOff(*places_.middle, b, fan, side, cast); }

  const Hemisphere& h_;
  const Places& places_;
  std::uint64_t address_;
  Sums& sums_;
  Sight sight_;
  int asked_ = 0;
  bool foundCut_ = false, askedOpen_ = false;
};

/// Traces a batch and adds it up; returns the rays cast.
std::uint32_t Hemisphere::finish(Batch& batch, const Places& places, std::uint64_t address, Sums& sums, glm::vec3* bent) const {
  const std::uint32_t cast = trace(batch);
  Judge judge(*this, batch, places, address, sums);
  for (std::size_t k = 0; k < batch.count; ++k) {
    const Block& b = batch.blocks[k];
    if (!judge.counts(b, batch.fans[k])) continue;
    Sums::Half& h = sums.halves[b.half];
    h.cosine += b.directions->allCosine;
    h.uniform += b.directions->allUniform;
    const Sums::Half blocked = blockedOf(b);
    h.blockedCosine += blocked.blockedCosine;
    h.blockedUniform += blocked.blockedUniform;
    if (!bent) continue;
    glm::vec3 open(0.0f);
    for (std::size_t i = 0; i < kBlock; ++i) open += (1.0f - shareOf(b, i)) * b.directions->cosine[i] * b.directions->towards[i];
    *bent += b.frame * open;
  }
  batch.count = 0;
  return cast + judge.cast;
}

std::uint32_t Hemisphere::castFrom(std::uint64_t address, std::uint32_t from, std::uint32_t until, const Places& places, Sums& sums,
                                   glm::vec3* bent) const {
  Batch batch;
  std::uint32_t cast = 0;
  for (std::uint32_t half = 0; half < 2; ++half) {
    Turn turn(address, half);
    const Sobol4 numbers = placesOf(address, half);
    for (std::uint32_t block = from / kBlock; block < until / kBlock; ++block) {
      if (batch.count == kBlocks) cast += finish(batch, places, address, sums, bent);
      start(batch, places.at(numbers.point2(block)), turn, block);
    }
  }
  if (batch.count > 0) cast += finish(batch, places, address, sums, bent);
  sums.rays = until;
  return cast;
}

std::uint32_t Hemisphere::cast(std::uint64_t address, std::uint32_t until, const Places& places, Sums& sums, glm::vec3* bent) const {
  if (until <= sums.rays) return 0;
  const bool unasked = sums.rays > 0 && sums.middle == Lie::Unknown, dark = sums.uniform() == 0.0;
  const glm::vec3 bentBefore = bent ? *bent : glm::vec3(0.0f);
  std::uint32_t cast = castFrom(address, sums.rays, until, places, sums, bent);
  // Only now it shows that places see different things: which of the first ones lay inside a solid, or beyond a wall, is asked again.
  if (unasked && (sums.middle == Lie::Closed || (dark && sums.middle == Lie::Free))) {
    sums = Sums{{}, 0, sums.middle};
    if (bent) *bent = bentBefore;
    cast += castFrom(address, 0, until, places, sums, bent);
  }
  return cast;
}

std::vector<RayFan> Hemisphere::fans(std::uint64_t address, std::uint32_t until, const Places& places) const {
  std::vector<RayFan> out;
  Batch batch;
  for (std::uint32_t half = 0; half < 2; ++half) {
    Turn turn(address, half);
    const Sobol4 numbers = placesOf(address, half);
    for (std::uint32_t block = 0; block < until / kBlock; ++block) {
      batch.count = 0;
      start(batch, places.at(numbers.point2(block)), turn, block);
      out.push_back(batch.fans[0]);
    }
  }
  return out;
}

AtPlace opennessAt(const SurfacePoint& place, const Tracer& tracer, const Options& options, std::uint32_t rays, std::uint64_t seed,
                   std::uint32_t scramble) {
  Sums sums;
  Hemisphere(tracer, options).cast(addressOf(seed, kNone, scramble), rays / 2, {[&](glm::vec2) { return place; }}, sums, nullptr);
  return {sums.cosine(), sums.uniform()};
}

}  // namespace lmc::ao
