#pragma once
/// Where the light of a neighbourhood comes from: rays found it, and later rays go there more often. A histogram over the unit square of
/// cosineHemisphere(), so that what guides is only a warp of the samples and their stratification holds.
#include <array>
#include <cstdint>
#include <glm/glm.hpp>

namespace lmc {

class Guide {
 public:
  static constexpr int kSide = 16;
  static constexpr float kBlind = 0.3f;  ///< share of rays that are not guided: no weight is above 1/kBlind

  /// So many rays were cast; those that met nothing need not be added.
  void count(std::size_t rays) { rays_ += float(rays); }

  /// A ray through u of the unit square brought back `light`; `weight` as warp() gave it.
  void add(glm::vec2 u, float light, float weight) {
    const int x = int(u.x * kSide), y = int(u.y * kSide);
    squares_[std::size_t(y * kSide + x)] += weight * light * light;
    sum_ += weight * light;
  }

  /// Takes what was added into account from now on, unless it would gain little: where light is even, weights are noise of their own.
  void build();

  /// Where the ray of sample u goes, and the factor on what it brings back: 1/density. Both as they came before the first build().
  glm::vec2 warp(glm::vec2 u, float& weight) const {
    weight = 1.0f;
    if (!built_) return u;
    // Columns by their share, then rows within the column.
    const int x = find(columns_.data(), u.x);
    const float* rows = rows_.data() + x * (kSide + 1);
    const int y = find(rows, u.y);
    const float columnShare = columns_[std::size_t(x) + 1] - columns_[std::size_t(x)], rowShare = rows[y + 1] - rows[y];
    weight = 1.0f / (columnShare * rowShare * float(kSide * kSide));
    const auto inside = [](int cell, float part) { return (float(cell) + glm::min(part, 0.99999f)) / float(kSide); };
    return {inside(x, (u.x - columns_[std::size_t(x)]) / columnShare), inside(y, (u.y - rows[y]) / rowShare)};
  }

  /// All that rays told it; what build() makes of it is no part.
  template <class Archive>
  void keep(Archive& archive) {
    archive(squares_);
    archive(sum_);
    archive(rays_);
  }

 private:
  /// The last cell that begins at or before u.
  static int find(const float* begins, float u) {
    int at = 0;
    for (int step = kSide / 2; step > 0; step /= 2)
      if (begins[at + step] <= u) at += step;
    return at;
  }
  std::array<float, kSide * kSide> squares_{};   // weighted squares of light, by rows of the square
  std::array<float, kSide + 1> columns_{};       // cumulative
  std::array<float, kSide*(kSide + 1)> rows_{};  // cumulative, of each column
  float sum_ = 0.0f, rays_ = 0.0f;
  bool built_ = false;
};

}  // namespace lmc
