#include "libscene/pack.h"

#include <algorithm>
#include <bit>
#include <optional>

namespace lmc {

namespace {

constexpr double kTouch = 1e-6;  // of a texel, as in forTouched

/// Sizes up to 16 texels as they are, larger ones in steps of an eighth.
int sizeClass(int size) {
  if (size <= 16) return size;
  const int shift = int(std::bit_width(unsigned(size))) - 4;
  return ((size >> shift) << shift);
}

}  // namespace

TexelMask::TexelMask(std::span<const std::array<glm::dvec2, 3>> triangles) : width_(1), height_(1) {
  glm::dvec2 hi(0.0);
  for (const auto& t : triangles)
    for (const glm::dvec2& c : t) hi = glm::max(hi, c);
  width_ = std::max(1, int(std::ceil(hi.x - kTouch)));
  height_ = std::max(1, int(std::ceil(hi.y - kTouch)));
  set_.assign(std::size_t(width_) * std::size_t(height_), 0);
  for (const auto& t : triangles) add(t);
}

void TexelMask::add(const std::array<glm::dvec2, 3>& triangle) {
  forTouched(triangle, width_, height_, [&](int y, int first, int last) {
    for (int x = first; x <= last; ++x) set(x, y);
  });
}

std::size_t TexelMask::count() const { return std::size_t(std::ranges::count(set_, 1)); }

TexelMask TexelMask::turned() const {
  TexelMask out(height_, width_);
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x)
      if (at(x, y)) out.set(height_ - 1 - y, x);
  return out;
}

glm::dvec2 placed(const Placement& p, glm::dvec2 at, int width, int height) {
  for (int q = 0; q < p.quarters; ++q) {
    at = {height - at.y, at.x};
    std::swap(width, height);
  }
  return at + glm::dvec2(p.x, p.y);
}

Packer::Packer(int width, int padding) : width_(width), padding_(padding), words_(std::size_t(width + 63) / 64) {
  levels_.resize(std::size_t(std::bit_width(unsigned(width))));
}

void Packer::growTo(int height) {
  if (height <= rows_) return;
  rows_ = std::max(height, rows_ + rows_ / 2 + 64);
  for (auto& level : levels_) level.resize(words_ * std::size_t(rows_), 0);
}

std::vector<Packer::Run> Packer::runs(const TexelMask& m) {
  std::vector<Run> out;
  for (int y = 0; y < m.height(); ++y)
    for (int x = 0; x < m.width();) {
      if (!m.at(x, y)) {
        ++x;
        continue;
      }
      const int begin = x;
      while (x < m.width() && m.at(x, y)) ++x;
      out.push_back({begin, y, x - begin});
    }
  // Long ones first: they rule places out soonest.
  std::ranges::stable_sort(out, [](const Run& a, const Run& b) { return a.length > b.length; });
  return out;
}

/// The first free x in the row, or -1.
int Packer::find(const std::vector<Run>& runs, int width, int y) const {
  std::vector<std::uint64_t> blocked(words_, 0);
  const int last = width_ - width;  // the last x where it fits
  for (std::size_t w = 0; w < words_; ++w) {
    const int begin = int(w) * 64;
    if (begin > last)
      blocked[w] = ~std::uint64_t(0);
    else if (begin + 63 > last)
      blocked[w] = ~std::uint64_t(0) << (last - begin + 1);
  }
  const auto add = [&](const std::uint64_t* from, int shift) {
    const auto whole = std::size_t(shift) / 64;
    const int part = shift % 64;
    for (std::size_t w = 0; w + whole < words_; ++w) {
      std::uint64_t bits = from[w + whole] >> part;
      if (part != 0 && w + whole + 1 < words_) bits |= from[w + whole + 1] << (64 - part);
      blocked[w] |= bits;
    }
  };
  int done = 0;
  for (const Run& r : runs) {
    if (y + r.y >= rows_) continue;
    const int level = int(std::bit_width(unsigned(r.length))) - 1;
    add(row(level, y + r.y), r.x);
    if (r.length != 1 << level) add(row(level, y + r.y), r.x + r.length - (1 << level));
    if (++done % 4 == 0 && std::ranges::all_of(blocked, [](std::uint64_t b) { return b == ~std::uint64_t(0); })) return -1;
  }
  for (std::size_t w = 0; w < words_; ++w)
    if (blocked[w] != ~std::uint64_t(0)) return int(w) * 64 + std::countr_one(blocked[w]);
  return -1;
}

void Packer::take(const TexelMask& m, int x, int y) {
  const int from = std::max(0, y - padding_), to = y + m.height() + padding_;
  growTo(to);
  height_ = std::max(height_, y + m.height());
  for (const Run& r : runs(m)) {
    const int x0 = std::max(0, x + r.x - padding_), x1 = std::min(width_, x + r.x + r.length + padding_);
    for (int v = std::max(from, y + r.y - padding_); v <= y + r.y + padding_; ++v)
      for (int u = x0; u < x1;) {
        const int end = std::min(x1, (u / 64 + 1) * 64), n = end - u;
        row(0, v)[u / 64] |= (n == 64 ? ~std::uint64_t(0) : ((std::uint64_t(1) << n) - 1) << (u % 64));
        u = end;
      }
  }
  for (std::size_t k = 1; k < levels_.size(); ++k)
    for (int v = from; v < to; ++v) {
      const std::uint64_t* below = row(int(k) - 1, v);
      std::uint64_t* here = row(int(k), v);
      const int shift = 1 << (k - 1);
      const auto whole = std::size_t(shift) / 64;
      const int part = shift % 64;
      for (std::size_t w = 0; w < words_; ++w) {
        std::uint64_t bits = w + whole < words_ ? below[w + whole] >> part : 0;
        if (part != 0 && w + whole + 1 < words_) bits |= below[w + whole + 1] << (64 - part);
        here[w] = below[w] | bits;
      }
    }
}

void Packer::block(const TexelMask& m, int at) { take(m, at, at); }

Placement Packer::add(const TexelMask& mask, int maxHeight) {
  Placement best{-1, 0, 0};
  int bestEnd = maxHeight + 1;
  TexelMask turned = mask;
  std::optional<TexelMask> chosen;
  for (int quarters = 0; quarters < 4; ++quarters) {
    if (quarters > 0) turned = turned.turned();
    if (turned.width() > width_) continue;
    const std::vector<Run> r = runs(turned);
    int& start = lowest_.try_emplace({sizeClass(turned.width()) * 4 + quarters, sizeClass(turned.height())}, 0).first->second;
    // A row that ends where another turn does already is no gain.
    for (int y = start; y + turned.height() < bestEnd; ++y) {
      const int x = find(r, turned.width(), y);
      start = std::max(start, y);
      if (x < 0) continue;
      best = {x, y, quarters};
      bestEnd = y + turned.height();
      chosen = turned;
      break;
    }
  }
  if (chosen) take(*chosen, best.x, best.y);
  return best;
}

}  // namespace lmc
