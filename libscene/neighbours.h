#pragma once
/// The texels round a texel.
#include <array>
#include <cstdint>
#include <span>

#include "libscene/scene.h"

namespace lmc {

inline constexpr std::size_t kNoTexel = ~std::size_t(0);

/// The eight neighbours of a texel in the order in which they lie round it; kNoTexel where one is not of its chart. `chart`: of each texel,
/// rows of `width`.
inline std::array<std::size_t, 8> ringOf(std::span<const std::uint32_t> chart, int width, std::size_t texel) {
  constexpr std::array<std::array<int, 2>, 8> kRound{{{-1, -1}, {0, -1}, {1, -1}, {1, 0}, {1, 1}, {0, 1}, {-1, 1}, {-1, 0}}};
  const int x = int(texel % std::size_t(width)), y = int(texel / std::size_t(width)), height = int(chart.size() / std::size_t(width));
  std::array<std::size_t, 8> out;
  for (std::size_t k = 0; k < out.size(); ++k) {
    const int nx = x + kRound[k][0], ny = y + kRound[k][1];
    const bool inside = nx >= 0 && ny >= 0 && nx < width && ny < height;
    const std::size_t i = inside ? std::size_t(ny) * std::size_t(width) + std::size_t(nx) : kNoTexel;
    out[k] = inside && chart[i] == chart[texel] ? i : kNoTexel;
  }
  return out;
}

}  // namespace lmc
