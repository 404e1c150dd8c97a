#pragma once
/// Directions of hemisphere rays, made once for all texels.
///
/// One ray serves both weightings. Its density over solid angle is half that of cosine rays and half that of uniform ones,
/// q(z) = (z + 1/2)/(2 pi), z = cosine to the normal: the balance heuristic of both [veach1995]. Then a cosine-weighted mean has the
/// weights (z/pi)/q = 2z/(z + 1/2) and a uniform one (1/(2 pi))/q = 1/(z + 1/2), 2 together. The second moment of either weight is
/// integral over z of (2z)^2/(z + 1/2) = integral of 1/(z + 1/2) = ln 3: rays of one kind alone would be better by 10 %, and worthless for
/// the other weighting.
#include <array>
#include <cstdint>
#include <glm/glm.hpp>

namespace lmc::ao {

inline constexpr std::uint32_t kBlock = 16;  ///< rays that start at one place: a well-spread set by itself
inline constexpr std::uint32_t kSets = 64, kRaysOfSet = 4096;

/// Directions about +z and their weights.
struct Directions {
  std::array<glm::vec3, kBlock> towards;
  std::array<float, kBlock> cosine, uniform;
  float allCosine = 0.0f, allUniform = 0.0f;  ///< their sums
};

/// Block of one of kSets independently scrambled Sobol sequences; a texel takes one of them and turns it about the normal. All are made at
/// the first call (20 ms, 5 MB).
const Directions& directions(std::uint32_t set, std::uint32_t block);

}  // namespace lmc::ao
