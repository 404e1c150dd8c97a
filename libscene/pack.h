#pragma once
/// Shapes on a texel grid put beside each other, whatever their outline, with a number of free texels between them.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <map>
#include <span>
#include <vector>

namespace lmc {

/// f(y, first x, last x) for the texels of a picture into whose squares a triangle reaches by more than `slack` texels.
template <class F>
void forTouched(const std::array<glm::dvec2, 3>& triangle, int width, int height, F f, double slack = 1e-6);

/// Texels that a shape touches.
class TexelMask {
 public:
  TexelMask(int width, int height) : width_(width), height_(height), set_(std::size_t(width) * std::size_t(height), 0) {}
  /// Of triangles in texels, corner after corner, none of them below 0.
  explicit TexelMask(std::span<const std::array<glm::dvec2, 3>> triangles);
  void add(const std::array<glm::dvec2, 3>& triangle);
  int width() const { return width_; }
  int height() const { return height_; }
  bool at(int x, int y) const { return set_[std::size_t(y) * std::size_t(width_) + std::size_t(x)]; }
  void set(int x, int y) { set_[std::size_t(y) * std::size_t(width_) + std::size_t(x)] = 1; }
  std::size_t count() const;
  /// By a quarter turn: what was at (x, y) is at (height - 1 - y, x).
  TexelMask turned() const;

 private:
  int width_, height_;
  std::vector<std::uint8_t> set_;
};

/// Where a shape lies: its mask turned so many quarters, with its first texel at (x, y).
struct Placement {
  int x = 0, y = 0, quarters = 0;
};

/// A place in texels of a mask that is so large, after it was turned as the placement says.
glm::dvec2 placed(const Placement&, glm::dvec2 at, int width, int height);

/// A strip of texels, as wide as said and as high as needed.
class Packer {
 public:
  explicit Packer(int width);
  /// Takes what is set, as if it were a shape of its own with its first texel at (at, at).
  void block(const TexelMask&, int at, int padding);
  /// The lowest free place, of four quarter turns, that ends above `maxHeight`; x = -1 where there is none. Takes it, and keeps
  /// so many texels about it free of shapes that come later.
  Placement add(const TexelMask&, int maxHeight, int padding);
  int height() const { return height_; }  ///< rows that shapes take

 private:
  struct Run {
    int x, y, length;
  };
  static std::vector<Run> runs(const TexelMask&);
  int find(const std::vector<Run>&, int width, int y) const;
  void take(const TexelMask&, int x, int y, int padding);
  void growTo(int height);
  std::uint64_t* row(int level, int y) { return levels_[std::size_t(level)].data() + std::size_t(y) * words_; }
  const std::uint64_t* row(int level, int y) const { return levels_[std::size_t(level)].data() + std::size_t(y) * words_; }

  int width_, height_ = 0, rows_ = 0;
  std::size_t words_;
  // levels_[k]: bit x of a row = a texel of [x, x + 2^k) is taken, padding included.
  std::vector<std::vector<std::uint64_t>> levels_;
  std::map<std::pair<int, int>, int> lowest_;  // by size: no shape of about that size fits below this row
};

template <class F>
void forTouched(const std::array<glm::dvec2, 3>& t, int width, int height, F f, double slack) {
  const double top = std::min({t[0].y, t[1].y, t[2].y}), bottom = std::max({t[0].y, t[1].y, t[2].y});
  const int y0 = std::clamp(int(std::floor(top + slack)), 0, height - 1),
            y1 = std::clamp(int(std::ceil(bottom - slack)) - 1, y0, height - 1);
  for (int y = y0; y <= y1; ++y) {
    // The triangle's extent within the row: its corners there, and its edges where they cross the row's borders.
    double lo = std::numeric_limits<double>::infinity(), hi = -lo;
    const auto reach = [&](double x) {
      lo = std::min(lo, x);
      hi = std::max(hi, x);
    };
    for (std::size_t k = 0; k < 3; ++k) {
      const glm::dvec2 a = t[k], b = t[(k + 1) % 3];
      if (a.y >= y && a.y <= y + 1) reach(a.x);
      for (const double edge : {double(y), double(y + 1)})
        if ((a.y < edge) != (b.y < edge)) reach(a.x + (b.x - a.x) * ((edge - a.y) / (b.y - a.y)));
    }
    if (lo > hi) continue;
    const int x0 = std::clamp(int(std::floor(lo + slack)), 0, width - 1);
    f(y, x0, std::clamp(int(std::ceil(hi - slack)) - 1, x0, width - 1));
  }
}

}  // namespace lmc
