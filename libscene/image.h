#pragma once
#include <cassert>
#include <cstddef>
#include <vector>

namespace lmc {

/// Rows from the top, as glTF and EXR have them.
template <class T>
struct Image {
  int width = 0, height = 0;
  std::vector<T> pixels;

  Image() = default;
  Image(int w, int h, T fill = T{}) : width(w), height(h), pixels(std::size_t(w) * std::size_t(h), fill) {}
  std::size_t index(int x, int y) const {
    assert(x >= 0 && x < width && y >= 0 && y < height);
    return std::size_t(y) * std::size_t(width) + std::size_t(x);
  }
  T& at(int x, int y) { return pixels[index(x, y)]; }
  const T& at(int x, int y) const { return pixels[index(x, y)]; }
  bool empty() const { return pixels.empty(); }
};

}  // namespace lmc
