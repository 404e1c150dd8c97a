#include "libscene/texels.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <unordered_map>

#include "libscene/polygon2.h"
#include "libscene/tracer.h"

namespace lmc {

namespace {

constexpr double kMinFragment_texel2 = 1e-9;  // slivers of rounding along shared edges
constexpr double kMinCovered = 1e-5;          // of a texel's square: less is rounding at a chart's edge, in the plane of the next wall
constexpr double kWholeSquare = 1.0 - 1e-6;

/// A triangle in texel coordinates of its map, counter-clockwise whatever the chart's mirroring.
struct MapTriangle {
  std::array<glm::dvec2, 3> corner;
  std::array<int, 3> order{0, 1, 2};
  glm::dvec2 lo, hi;
};

MapTriangle mapTriangle(const Scene& scene, std::uint32_t triangle, int side) {
  MapTriangle m;
  const glm::uvec3 t = scene.triangles[triangle];
  for (int k = 0; k < 3; ++k) m.corner[std::size_t(k)] = scene.mapPlace(scene.objectOf(triangle), t[k], side);
  if (Polygon2::cross(m.corner[1] - m.corner[0], m.corner[2] - m.corner[0]) < 0.0) {
    std::swap(m.corner[1], m.corner[2]);
    m.order = {0, 2, 1};
  }
  m.lo = glm::min(glm::min(m.corner[0], m.corner[1]), m.corner[2]);
  m.hi = glm::max(glm::max(m.corner[0], m.corner[1]), m.corner[2]);
  return m;
}

/// bary0, baryX, baryY of a fragment: the inverse of the triangle's UV map, about the texel's corner.
void setBary(Fragment& f, const MapTriangle& m, glm::dvec2 origin) {
  const glm::dvec2 e1 = m.corner[1] - m.corner[0], e2 = m.corner[2] - m.corner[0];
  const double det = Polygon2::cross(e1, e2);
  const glm::dvec2 d = origin - m.corner[0];
  glm::dvec2 b0(Polygon2::cross(d, e2) / det, Polygon2::cross(e1, d) / det);
  glm::dvec2 bx(e2.y / det, -e1.y / det), by(-e2.x / det, e1.x / det);
  if (m.order[1] == 2) {
    std::swap(b0.x, b0.y);
    std::swap(bx.x, bx.y);
    std::swap(by.x, by.y);
  }
  f.bary0 = b0;
  f.baryX = bx;
  f.baryY = by;
}

glm::dvec2 insideTriangle(glm::dvec2 b) {
  b = glm::max(b, glm::dvec2(0.0));
  const double sum = b.x + b.y;
  return sum > 1.0 ? b / sum : b;
}

}  // namespace

SurfacePoint surfacePoint(const Scene& scene, std::uint32_t triangle, glm::dvec2 bary) { return Facet(scene, triangle).at(bary); }

Facet::Facet(const Scene& scene, std::uint32_t triangle) : triangle_(triangle) {
  const auto c = scene.corners_m(triangle);
  origin_m_ = c[0];
  e1_m_ = c[1] - c[0];
  e2_m_ = c[2] - c[0];
  const glm::dvec3 n = glm::cross(e1_m_, e2_m_);
  const double length = glm::length(n);
  geometricNormal_ = length > 0.0 ? n / length : glm::dvec3(0.0, 1.0, 0.0);
  const glm::uvec3 t = scene.triangles[triangle];
  n0_ = glm::dvec3(scene.normals[t.x]);
  n1_ = glm::dvec3(scene.normals[t.y]);
  n2_ = glm::dvec3(scene.normals[t.z]);
  flat_ = n0_ == n1_ && n1_ == n2_;
  if (!flat_) return;
  const double l = glm::length(n0_);
  n0_ = l > 1e-12 ? n0_ / l : geometricNormal_;
}

SurfacePoint Facet::at(glm::dvec2 bary) const {
  SurfacePoint p;
  p.triangle = triangle_;
  p.bary = glm::vec2(bary);
  p.position_m = origin_m_ + bary.x * e1_m_ + bary.y * e2_m_;
  p.geometricNormal = geometricNormal_;
  p.normal = n0_;
  if (!flat_) {
    const glm::dvec3 s = (1.0 - bary.x - bary.y) * n0_ + bary.x * n1_ + bary.y * n2_;
    const double l = glm::length(s);
    p.normal = l > 1e-12 ? s / l : geometricNormal_;
  }
  return p;
}

TexelSampler::TexelSampler(const Scene& scene, const TexelTile& tile, const Texel& texel) : tile_(tile), texel_(texel) {
  assert(texel.fragmentCount > 0);
  facets_.reserve(texel.fragmentCount);
  for (std::uint32_t i = 0; i < texel.fragmentCount; ++i) facets_.emplace_back(scene, tile.fragments[texel.firstFragment + i].triangle);
}

/// Who lies at a place of the square, or nearest to it.
std::size_t TexelSampler::fragmentAt(glm::dvec2 at) const {
  std::size_t out = 0;
  double best = -1e300;
  for (std::size_t i = 0; i < texel_.fragmentCount && texel_.fragmentCount > 1; ++i) {
    const Fragment& f = tile_.fragments[texel_.firstFragment + i];
    const glm::dvec2 b = f.bary0 + at.x * f.baryX + at.y * f.baryY;
    const double inside = std::min({b.x, b.y, 1.0 - b.x - b.y});
    if (inside > best) {
      best = inside;
      out = i;
    }
  }
  return out;
}

SurfacePoint TexelSampler::at(std::size_t fragment, glm::dvec2 at) const {
  const Fragment& f = tile_.fragments[texel_.firstFragment + fragment];
  return facets_[fragment].at(insideTriangle(f.bary0 + at.x * f.baryX + at.y * f.baryY));
}

template <class F>
void TexelSampler::forTriangles(const F& f) const {
  for (std::size_t i = 0; i < texel_.fragmentCount; ++i) {
    const Fragment& fragment = tile_.fragments[texel_.firstFragment + i];
    const glm::dvec2* p = tile_.corners.data() + fragment.firstCorner;
    for (std::uint32_t k = 2; k < fragment.cornerCount; ++k) {
      const double area = 0.5 * Polygon2::cross(p[k - 1] - p[0], p[k] - p[0]);
      if (area > 0.0 && !f(i, p[0], p[k - 1], p[k], area)) return;
    }
  }
}

SurfacePoint TexelSampler::middle() const {
  glm::dvec2 place(0.5);
  if (texel_.coverage < kWholeSquare) {
    glm::dvec2 sum(0.0);
    double all = 0.0;
    forTriangles([&](std::size_t, glm::dvec2 a, glm::dvec2 b, glm::dvec2 c, double area) {
      sum += area / 3.0 * (a + b + c);
      all += area;
      return true;
    });
    if (all > 0.0) place = sum / all;
  }
  return at(fragmentAt(place), place);
}

SurfacePoint TexelSampler::at(glm::vec2 u) const {
  // A full square keeps the sample where it is, so that its stratification holds.
  if (texel_.coverage >= kWholeSquare) return at(fragmentAt(glm::dvec2(u)), glm::dvec2(u));
  // Choose a triangle of the fans by area with u.x, and use what is left of u.x again within it.
  double target = double(u.x) * texel_.coverage, part = 0.0;
  std::size_t chosen = 0;
  glm::dvec2 a(0.0), b(0.0), c(0.0);
  forTriangles([&](std::size_t fragment, glm::dvec2 first, glm::dvec2 second, glm::dvec2 third, double area) {
    target -= part;
    chosen = fragment, a = first, b = second, c = third, part = area;
    return target >= area;
  });
  const double s = std::sqrt(std::clamp(part > 0.0 ? target / part : 0.5, 0.0, 1.0));
  return at(chosen, a + s * (1.0 - double(u.y)) * (b - a) + s * double(u.y) * (c - a));
}

TexelMap::TexelMap(const Scene& scene, const Charts& charts, int side, int maps)
    : scene_(scene), charts_(charts), width_(side), height_(side * maps) {
  // Two passes over the triangles: count, then place. Triangles of a tile stay in order of their number.
  const auto forTiles = [&](auto&& f) {
    for (std::uint32_t t = 0; t < scene_.triangles.size(); ++t) {
      if (charts_.chartOf[t] == kNone) continue;
      const MapTriangle m = mapTriangle(scene_, t, width_);
      const glm::dvec2 size(width_, height_);
      const glm::dvec2 lo = glm::clamp(m.lo - double(kApron), glm::dvec2(0.0), size),
                       hi = glm::clamp(m.hi + double(kApron), glm::dvec2(0.0), size);
      const int x1 = std::min(tilesX() - 1, int(hi.x) / kTile), y1 = std::min(tilesY() - 1, int(hi.y) / kTile);
      for (int y = int(lo.y) / kTile; y <= y1; ++y)
        for (int x = int(lo.x) / kTile; x <= x1; ++x) f(std::size_t(y) * std::size_t(tilesX()) + std::size_t(x), t);
    }
  };
  first_.assign(tileCount() + 1, 0);
  forTiles([&](std::size_t tile, std::uint32_t) { ++first_[tile + 1]; });
  for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
  triangles_.resize(first_.back());
  std::vector<std::uint32_t> next(first_.begin(), first_.end() - 1);
  forTiles([&](std::size_t tile, std::uint32_t t) { triangles_[next[tile]++] = t; });
}

std::uint32_t numberChartBlocks(std::span<const std::uint32_t> chart, int width, int side, std::span<std::uint32_t> blockOf) {
  std::unordered_map<std::uint64_t, std::uint32_t> known;  // of the row of blocks
  std::uint32_t blocks = 0;
  for (std::size_t i = 0; i < chart.size(); ++i) {
    const std::size_t x = i % std::size_t(width), y = i / std::size_t(width);
    if (x == 0 && y % std::size_t(side) == 0) known.clear();
    blockOf[i] = kNone;
    if (chart[i] == kNone) continue;
    const auto [it, fresh] = known.try_emplace(std::uint64_t(chart[i]) << 32 | x / std::size_t(side), blocks);
    blocks += fresh;
    blockOf[i] = it->second;
  }
  return blocks;
}

std::shared_ptr<const TexelTile> TexelMap::held(std::size_t tile) const {
  {
    const std::lock_guard lock(mutex_);
    if (tile < kept_.size() && kept_[tile]) return kept_[tile];
  }
  auto made = std::make_shared<TexelTile>(texels(tile));
  made->texels.shrink_to_fit();
  made->fragments.shrink_to_fit();
  made->corners.shrink_to_fit();
  const std::uint64_t bytes =
      made->texels.size() * sizeof(Texel) + made->fragments.size() * sizeof(Fragment) + made->corners.size() * sizeof(glm::dvec2);
  const std::lock_guard lock(mutex_);
  if (kept_bytes_ + bytes <= mayKeep_bytes_) {
    kept_.resize(tileCount());
    if (!kept_[tile]) {
      kept_[tile] = made;
      kept_bytes_ += bytes;
    }
  }
  return made;
}

TexelTile TexelMap::texels(std::size_t tileIndex) const {
  TexelTile tile;
  tile.x0 = int(tileIndex % std::size_t(tilesX())) * kTile;
  tile.y0 = int(tileIndex / std::size_t(tilesX())) * kTile;
  tile.width = std::min(kTile, width_ - tile.x0);
  tile.height = std::min(kTile, height_ - tile.y0);
  constexpr int kSpan = kTile + 2 * kApron;

  struct Found {
    std::uint32_t cell;
    std::uint32_t chart;
    Fragment fragment;
  };
  std::vector<Found> found;
  Polygon2 row, cell;
  for (std::uint32_t i = first_[tileIndex]; i < first_[tileIndex + 1]; ++i) {
    const std::uint32_t t = triangles_[i];
    const MapTriangle m = mapTriangle(scene_, t, width_);
    const int x0 = std::max({int(std::floor(m.lo.x)), tile.x0 - kApron, 0}),
              x1 = std::min({int(std::floor(m.hi.x)), tile.x0 + tile.width - 1 + kApron, width_ - 1});
    const int y0 = std::max({int(std::floor(m.lo.y)), tile.y0 - kApron, 0}),
              y1 = std::min({int(std::floor(m.hi.y)), tile.y0 + tile.height - 1 + kApron, height_ - 1});
    for (int y = y0; y <= y1; ++y) {
      row.assign({m.corner[0], m.corner[1], m.corner[2]});
      row.clip({0.0, double(y)}, {1.0, 0.0});
      row.clip({0.0, double(y + 1)}, {-1.0, 0.0});
      if (row.corners().size() < 3) continue;
      double lo = row.corners()[0].x, hi = lo;
      for (const glm::dvec2& c : row.corners()) {
        lo = std::min(lo, c.x);
        hi = std::max(hi, c.x);
      }
      const int end = std::min(x1, int(std::floor(hi)));
      for (int x = std::max(x0, int(std::floor(lo))); x <= end; ++x) {
        cell = row;
        cell.clip({double(x), 0.0}, {0.0, -1.0});
        cell.clip({double(x + 1), 0.0}, {0.0, 1.0});
        const double area = cell.area();
        if (cell.corners().size() < 3 || area < kMinFragment_texel2) continue;
        Found f;
        f.cell = std::uint32_t((y - tile.y0 + kApron) * kSpan + (x - tile.x0 + kApron));
        f.chart = charts_.chartOf[t];
        f.fragment.triangle = t;
        f.fragment.area = area;
        f.fragment.firstCorner = std::uint32_t(tile.corners.size());
        f.fragment.cornerCount = std::uint32_t(cell.corners().size());
        for (const glm::dvec2& c : cell.corners()) tile.corners.push_back(c - glm::dvec2(x, y));
        setBary(f.fragment, m, {double(x), double(y)});
        found.push_back(f);
      }
    }
  }
  std::ranges::stable_sort(found, [](const Found& a, const Found& b) { return a.cell != b.cell ? a.cell < b.cell : a.chart < b.chart; });

  tile.texels.resize(std::size_t(kSpan) * kSpan);
  for (std::size_t i = 0; i < found.size();) {
    // Of the charts in this texel, the one that covers most.
    const std::uint32_t at = found[i].cell;
    std::size_t bestBegin = i, bestEnd = i;
    double bestArea = -1.0;
    while (i < found.size() && found[i].cell == at) {
      const std::size_t begin = i;
      double area = 0.0;
      for (; i < found.size() && found[i].cell == at && found[i].chart == found[begin].chart; ++i) area += found[i].fragment.area;
      if (area > bestArea) {
        bestArea = area;
        bestBegin = begin;
        bestEnd = i;
      }
    }
    if (bestArea < kMinCovered) continue;
    Texel& texel = tile.texels[at];
    texel.chart = found[bestBegin].chart;
    texel.coverage = float(std::min(1.0, bestArea));
    texel.firstFragment = std::uint32_t(tile.fragments.size());
    texel.fragmentCount = std::uint32_t(bestEnd - bestBegin);
    for (std::size_t k = bestBegin; k < bestEnd; ++k) tile.fragments.push_back(found[k].fragment);
  }
  return tile;
}

}  // namespace lmc
