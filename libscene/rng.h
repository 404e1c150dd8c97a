#pragma once
/// Random numbers that have an address, not a turn: (seed, effect, map, x, y) names a scrambled Sobol sequence, and an index a point
/// of it. Skipping a texel or a light changes no other's numbers.
///
/// Sobol: direction numbers of [joe2008], dimensions 1 to 4. Scrambling: nested uniform [owen1995], done by a hash whose every bit
/// depends on the bits above it alone (the idea of [laine2011]).
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <string_view>

namespace lmc {

/// Bijective mix of 64 bits (the finaliser of splitmix64).
constexpr std::uint64_t mix64(std::uint64_t x) {
  x ^= x >> 30;
  x *= 0xbf58476d1ce4e5b9ull;
  x ^= x >> 27;
  x *= 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}
constexpr std::uint64_t combine(std::uint64_t a, std::uint64_t b) { return mix64(a + 0x9e3779b97f4a7c15ull + mix64(b)); }

/// The address of a name, such as a light's path.
constexpr std::uint64_t hashName(std::string_view name) {
  std::uint64_t h = 0xcbf29ce484222325ull;
  for (const char c : name) h = (h ^ std::uint8_t(c)) * 0x100000001b3ull;
  return mix64(h);
}

/// What a sequence of random numbers is for. Values are part of the results: append only.
enum class Draw : std::uint64_t {
  Direct = 1,
  Hemisphere = 2,
  PatchDirect = 3,
  PatchSky = 4,
  Shoot = 5,
  Visibility = 6,
  Closure = 7,
  NearHit = 8,
  Links = 9,
  Openness = 10,
  Audit = 11,
  AuditChoice = 12,
  Burial = 13
};

namespace sobol {
// Direction numbers in reversed bit order, so that a scramble (which works from the highest bit down) is one multiply-and-add chain.
constexpr std::array<std::array<std::uint32_t, 32>, 4> makeDirections() {
  struct Poly {
    int s;
    std::uint32_t a;
    std::uint32_t m[3];
  };
  constexpr Poly kPoly[3] = {{1, 0, {1, 0, 0}}, {2, 1, {1, 3, 0}}, {3, 1, {1, 3, 1}}};
  std::array<std::array<std::uint32_t, 32>, 4> v{};
  for (int i = 0; i < 32; ++i) v[0][i] = 1u << (31 - i);
  for (int d = 1; d < 4; ++d) {
    const Poly p = kPoly[d - 1];
    for (int i = 0; i < 32; ++i) {
      if (i < p.s) {
        v[d][i] = p.m[i] << (31 - i);
        continue;
      }
      v[d][i] = v[d][i - p.s] ^ (v[d][i - p.s] >> p.s);
      for (int k = 1; k < p.s; ++k)
        if ((p.a >> (p.s - 1 - k)) & 1u) v[d][i] ^= v[d][i - k];
    }
  }
  return v;
}
constexpr std::uint32_t reversed(std::uint32_t x) {
  x = (x >> 16) | (x << 16);
  x = ((x & 0x00ff00ffu) << 8) | ((x & 0xff00ff00u) >> 8);
  x = ((x & 0x0f0f0f0fu) << 4) | ((x & 0xf0f0f0f0u) >> 4);
  x = ((x & 0x33333333u) << 2) | ((x & 0xccccccccu) >> 2);
  return ((x & 0x55555555u) << 1) | ((x & 0xaaaaaaaau) >> 1);
}
using Tables = std::array<std::array<std::array<std::uint32_t, 256>, 4>, 4>;  // dimension, byte of the index, its value
constexpr Tables makeTables() {
  Tables t{};
  constexpr auto v = makeDirections();
  for (std::size_t d = 0; d < 4; ++d)
    for (std::size_t b = 0; b < 4; ++b)
      for (std::size_t value = 0; value < 256; ++value) {
        std::uint32_t x = 0;
        for (std::size_t bit = 0; bit < 8; ++bit)
          if ((value >> bit) & 1u) x ^= v[d][b * 8 + bit];
        t[d][b][value] = reversed(x);
      }
  return t;
}
inline constexpr Tables kTables = makeTables();
}  // namespace sobol

class Sobol4 {
 public:
  /// One sequence for each key; different keys are independent.
  explicit constexpr Sobol4(std::uint64_t key) {
    for (std::uint32_t d = 0; d < 4; ++d) seeds_[d] = std::uint32_t(combine(key, d) >> 32);
  }
  /// Four coordinates in [0, 1), the first two (and the last two) a good pair.
  glm::vec4 point(std::uint32_t index) const {
    return {coordinate(index, 0), coordinate(index, 1), coordinate(index, 2), coordinate(index, 3)};
  }
  glm::vec2 point2(std::uint32_t index) const { return {coordinate(index, 0), coordinate(index, 1)}; }

 private:
  float coordinate(std::uint32_t index, std::uint32_t d) const {
    const auto& t = sobol::kTables[d];
    std::uint32_t x = t[0][index & 255u] ^ t[1][(index >> 8) & 255u] ^ t[2][(index >> 16) & 255u] ^ t[3][index >> 24];
    // Bits are reversed here: carries and products move information upwards only, that is from the coordinate's high bits to its low ones.
    const std::uint32_t s = seeds_[d];
    x += s;
    x ^= x * 0x6c50b47cu;
    x *= (s >> 15) | 1u;
    x ^= x * 0xb82f1e52u;
    x ^= x * 0xc7afe638u;
    x += ((s << 16) | (s >> 16)) * 0x9e3779b1u;  // other bits of the seed: s twice would take itself out of the highest bit again
    x ^= x * 0x8d22f6e6u;
    return float(sobol::reversed(x) >> 8) * 0x1p-24f;
  }
  std::array<std::uint32_t, 4> seeds_{};
};

/// The sequence of one texel (or patch: x = its id) for one purpose; `half` numbers independent scrambles of it.
constexpr Sobol4 sequence(std::uint64_t seed, Draw draw, std::uint64_t name, std::uint32_t map, std::uint32_t x, std::uint32_t y,
                          std::uint32_t half) {
  std::uint64_t key = combine(seed, std::uint64_t(draw));
  key = combine(key, name);
  key = combine(key, (std::uint64_t(map) << 32) | half);
  return Sobol4(combine(key, (std::uint64_t(x) << 32) | y));
}

}  // namespace lmc
