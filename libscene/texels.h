#pragma once
/// Texels of a light map, made tile by tile on demand: which part of the texel's square its chart covers, and places to sample in it.
#include <algorithm>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

#include "libscene/charts.h"
#include "libscene/scene.h"

namespace lmc {

inline constexpr int kTile = 64;  ///< side of a tile [texels]; no option changes it, for results would change with it
inline constexpr int kApron = 1;  ///< texels of the neighbours that a tile knows as well

/// A place on a surface.
struct SurfacePoint {
  glm::dvec3 position_m;
  glm::dvec3 geometricNormal;  ///< unit, of the triangle, towards its front
  glm::dvec3 normal;           ///< unit, interpolated
  std::uint32_t triangle = kNone;
  glm::vec2 bary{0.0f};  ///< weights of the second and third corner
};

/// The point with these weights of the second and third corner, all in double.
SurfacePoint surfacePoint(const Scene&, std::uint32_t triangle, glm::dvec2 bary);

/// Which triangle lies under a place of the map: part of one triangle in one texel.
struct Fragment {
  std::uint32_t triangle = kNone;
  std::uint32_t firstCorner = 0;
  std::uint32_t cornerCount = 0;
  double area = 0.0;               ///< share of the texel's square
  glm::dvec2 bary0, baryX, baryY;  ///< bary(x, y) = bary0 + x baryX + y baryY, x and y in [0, 1) of the texel
};

struct Texel {
  std::uint32_t firstFragment = 0, fragmentCount = 0;
  std::uint32_t chart = kNone;
  float coverage = 0.0f;  ///< share of the square that the chart covers; 0 = outside every chart
};

struct TexelTile {
  int x0 = 0, y0 = 0;         ///< the tile's first texel in the map
  int width = 0, height = 0;  ///< texels of the tile itself, at most kTile
  std::vector<Texel> texels;  ///< rows of kTile + 2 kApron, the apron included
  std::vector<Fragment> fragments;
  std::vector<glm::dvec2> corners;  ///< of the fragments' polygons, counter-clockwise, in [0, 1] of the texel

  /// x, y from -kApron to kTile - 1 + kApron.
  const Texel& at(int x, int y) const { return texels[std::size_t(y + kApron) * (kTile + 2 * kApron) + std::size_t(x + kApron)]; }
};

/// A triangle as double values, made once for many places on it.
class Facet {
 public:
  Facet(const Scene&, std::uint32_t triangle);
  /// The point with these weights of the second and third corner.
  SurfacePoint at(glm::dvec2 bary) const;

 private:
  std::uint32_t triangle_;
  bool flat_;  // the corners' normals are one
  glm::dvec3 origin_m_, e1_m_, e2_m_, geometricNormal_;
  glm::dvec3 n0_, n1_, n2_;  // flat: n0 is the unit normal
};

/// x and y of the k-th texel along the Morton curve of a tile: rays of one neighbourhood after each other find its geometry in the cache.
constexpr std::pair<int, int> alongMorton(std::uint32_t k) {
  const auto everySecondBit = [](std::uint32_t b) {
    b &= 0x55555555u;
    b = (b | b >> 1) & 0x33333333u;
    b = (b | b >> 2) & 0x0f0f0f0fu;
    b = (b | b >> 4) & 0x00ff00ffu;
    return int((b | b >> 8) & 0xffffu);
  };
  return {everySecondBit(k), everySecondBit(k >> 1)};
}

/// Places in the covered part of a texel, which must be covered.
class TexelSampler {
 public:
  TexelSampler(const Scene&, const TexelTile&, const Texel&);
  /// Uniform in the map's plane for u uniform in the unit square.
  SurfacePoint at(glm::vec2 u) const;
  /// The middle of the covered part, or what of that part lies nearest to it.
  SurfacePoint middle() const;

 private:
  /// f(fragment, its triangle, its area in texels) for the fans of the fragments' polygons, until it returns false.
  template <class F>
  void forTriangles(const F& f) const;
  std::size_t fragmentAt(glm::dvec2 at) const;
  SurfacePoint at(std::size_t fragment, glm::dvec2 at) const;
  const TexelTile& tile_;
  const Texel& texel_;
  std::vector<Facet> facets_;  // one a fragment
};

/// Numbers the blocks of side x side texels of each chart as rows from the top meet them; kNone where no chart is. Returns how many there
/// are.
std::uint32_t numberChartBlocks(std::span<const std::uint32_t> chart, int width, int side, std::span<std::uint32_t> blockOf);

/// All texels of a level's square maps, which lie one below the other.
class TexelMap {
 public:
  TexelMap(const Scene&, const Charts&, int side, int maps = 1);
  int width() const { return width_; }
  int height() const { return height_; }
  int tilesX() const { return (width_ + kTile - 1) / kTile; }
  int tilesY() const { return (height_ + kTile - 1) / kTile; }
  std::size_t tileCount() const { return std::size_t(tilesX()) * std::size_t(tilesY()); }
  /// Where two charts meet in a texel, the one that covers more of it (the lower number where they tie) has it.
  TexelTile texels(std::size_t tile) const;
  /// The same; stages come back to a tile many times, and find it as it was while all that are kept fit into keepAtMost(). Thread-safe.
  std::shared_ptr<const TexelTile> held(std::size_t tile) const;
  /// Those texels of a tile, rows from the top, for which want(index in the map) holds.
  template <class Want>
  std::vector<std::size_t> texelsOf(std::size_t tile, const Want& want) const {
    std::vector<std::size_t> out;
    const int x0 = int(tile % std::size_t(tilesX())) * kTile, y0 = int(tile / std::size_t(tilesX())) * kTile;
    for (int y = y0; y < std::min(y0 + kTile, height_); ++y)
      for (int x = x0; x < std::min(x0 + kTile, width_); ++x)
        if (const std::size_t i = std::size_t(y) * std::size_t(width_) + std::size_t(x); want(i)) out.push_back(i);
    return out;
  }
  void keepAtMost(std::uint64_t bytes) { mayKeep_bytes_ = bytes; }

 private:
  const Scene& scene_;
  const Charts& charts_;
  int width_, height_;
  std::vector<std::uint32_t> first_, triangles_;  // per tile (apron included): its triangles
  std::uint64_t mayKeep_bytes_ = 0;
  mutable std::mutex mutex_;  // of what follows
  mutable std::uint64_t kept_bytes_ = 0;
  mutable std::vector<std::shared_ptr<const TexelTile>> kept_;
};

}  // namespace lmc
