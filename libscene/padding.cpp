#include "libscene/padding.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "libscene/parallel.h"
#include "libscene/polygon2.h"

namespace lmc {

namespace {

struct Claim {
  std::uint32_t texel, chart;
  auto operator<=>(const Claim&) const = default;
};

/// The nearest so far, the lower number where two tie.
struct Nearest {
  int distance2 = kPadding * kPadding;  // [texels^2]
  std::uint32_t texel = kNone;
  void offer(int d2, std::size_t index) {
    if (d2 > distance2 || (d2 == distance2 && index >= texel)) return;
    distance2 = d2;
    texel = std::uint32_t(index);
  }
};

class Layout {
 public:
  Layout(const Scene& scene, const Charts& charts, std::span<const std::uint32_t> chart, int side)
      : scene_(scene), charts_(charts), chart_(chart), side_(side), height_(int(chart.size() / std::size_t(side))) {}

  int side() const { return side_; }
  int height() const { return height_; }
  std::size_t index(int x, int y) const { return std::size_t(y) * std::size_t(side_) + std::size_t(x); }
  int firstRow(int y) const { return y - y % side_; }  // of the map that y is in
  bool covered(std::size_t i) const { return chart_[i] != kNone; }

  /// Texels that bilinear lookups in a triangle read, but for those that its chart covers.
  void claims(std::uint32_t triangle, std::vector<Claim>& out) const {
    const std::uint32_t chart = charts_.chartOf[triangle];
    const Object& object = scene_.objectOf(triangle);
    const glm::uvec3 t = scene_.triangles[triangle];
    std::array<glm::dvec2, 3> c{scene_.mapPlace(object, t.x, side_), scene_.mapPlace(object, t.y, side_),
                                scene_.mapPlace(object, t.z, side_)};
    if (Polygon2::cross(c[1] - c[0], c[2] - c[0]) < 0.0) std::swap(c[1], c[2]);
    const double lowest = std::min({c[0].y, c[1].y, c[2].y}), highest = std::max({c[0].y, c[1].y, c[2].y});
    const int top = int(object.map) * side_;
    const int y0 = std::max(top, int(std::floor(lowest - 1.5)) + 1), y1 = std::min(top + side_ - 1, int(std::ceil(highest + 0.5)) - 1);
    Polygon2 strip;
    for (int y = y0; y <= y1; ++y) {
      // What of the triangle lies less than 1 texel from the row's centres. It is convex, so that its extent in x tells which it reaches.
      strip.assign({c[0], c[1], c[2]});
      strip.clip({0.0, y - 0.5}, {1.0, 0.0});
      strip.clip({0.0, y + 1.5}, {-1.0, 0.0});
      if (strip.corners().size() < 3) continue;
      const auto [left, right] = std::ranges::minmax(strip.corners(), {}, &glm::dvec2::x);
      const int x0 = std::max(0, int(std::floor(left.x - 1.5)) + 1), x1 = std::min(side_ - 1, int(std::ceil(right.x + 0.5)) - 1);
      for (int x = x0; x <= x1; ++x)
        if (const std::size_t i = index(x, y); chart_[i] != chart) out.push_back({std::uint32_t(i), chart});
    }
  }

  /// The nearest texel that the chart covers. It lies beside the texel unless others took all that the chart has there.
  Nearest nearestOf(const Claim& claim) const {
    const int x = int(claim.texel % std::size_t(side_)), y = int(claim.texel / std::size_t(side_));
    Nearest best;
    for (const int reach : {1, kPadding}) {
      for (int v = std::max(firstRow(y), y - reach); v <= std::min(firstRow(y) + side_ - 1, y + reach); ++v)
        for (int u = std::max(0, x - reach); u <= std::min(side_ - 1, x + reach); ++u)
          if (const std::size_t i = index(u, v); chart_[i] == claim.chart) best.offer((u - x) * (u - x) + (v - y) * (v - y), i);
      if (best.texel != kNone) break;
    }
    return best;
  }

 private:
  const Scene& scene_;
  const Charts& charts_;
  std::span<const std::uint32_t> chart_;
  int side_, height_;
};

constexpr std::int8_t kFar = 127;

/// Rows down to the nearest covered texel of the same column, upwards where two tie; kFar above kPadding.
TexelArray<std::int8_t> rowsToCovered(const Layout& layout) {
  TexelArray<std::int8_t> rows(std::size_t(layout.side()) * std::size_t(layout.height()), kFar);
  std::vector<int> last(std::size_t(layout.side()));
  for (int y = 0; y < layout.height(); ++y) {
    if (y == layout.firstRow(y)) std::ranges::fill(last, -2 * kPadding - layout.height());
    for (int x = 0; x < layout.side(); ++x) {
      const std::size_t i = layout.index(x, y);
      if (layout.covered(i)) last[std::size_t(x)] = y;
      if (const int up = y - last[std::size_t(x)]; up <= kPadding) rows[i] = std::int8_t(-up);
    }
  }
  for (int y = layout.height() - 1; y >= 0; --y) {
    if (y == layout.firstRow(y) + layout.side() - 1) std::ranges::fill(last, 2 * (kPadding + layout.height()));
    for (int x = 0; x < layout.side(); ++x) {
      const std::size_t i = layout.index(x, y);
      if (layout.covered(i)) last[std::size_t(x)] = y;
      if (const int down = last[std::size_t(x)] - y; down <= kPadding && down < std::abs(rows[i])) rows[i] = std::int8_t(down);
    }
  }
  return rows;
}

}  // namespace

Padding makePadding(const Scene& scene, const Charts& charts, std::span<const std::uint32_t> chart, int side, const Run& run) {
  const Layout layout(scene, charts, chart, side);
  Padding out;
  out.from.assign(chart.size(), kNone);

  std::vector<Claim> claims;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t)
    if (charts.chartOf[t] != kNone) layout.claims(t, claims);
  std::ranges::sort(claims);
  claims.erase(std::unique(claims.begin(), claims.end()), claims.end());
  run.progress(0.5);
  for (std::size_t i = 0; i < claims.size();) {
    const std::uint32_t texel = claims[i].texel;
    std::size_t wanted = layout.covered(texel);
    Nearest best;
    for (; i < claims.size() && claims[i].texel == texel; ++i, ++wanted) {
      if (layout.covered(texel)) continue;
      const Nearest n = layout.nearestOf(claims[i]);
      if (n.texel != kNone) best.offer(n.distance2, n.texel);
    }
    out.from[texel] = best.texel;
    if (wanted > 1) out.contested.push_back(texel);
  }

  const TexelArray<std::int8_t> rows = rowsToCovered(layout);
  parallelFor(run, std::size_t(layout.height()), 16, [&](std::size_t row) {
    const int y = int(row);
    for (int x = 0; x < side; ++x) {
      const std::size_t i = layout.index(x, y);
      if (layout.covered(i)) {
        out.from[i] = std::uint32_t(i);
        continue;
      }
      if (out.from[i] != kNone) continue;
      Nearest best;
      for (int u = std::max(0, x - kPadding); u <= std::min(side - 1, x + kPadding); ++u)
        if (const int down = rows[layout.index(u, y)]; down != kFar) best.offer((u - x) * (u - x) + down * down, layout.index(u, y + down));
      out.from[i] = best.texel;
    }
  });
  return out;
}

}  // namespace lmc
