#include "libradiosity/slopes.h"

#include <unordered_set>

#include "libscene/parallel.h"

namespace lmc {

namespace {

constexpr double kRidge =
    0.02;  // of the moments' trace: neighbours along one line say nothing of the other direction, where the slope is none

}  // namespace

Slopes::Slopes(const Scene& scene, const PatchMesh& mesh, const DirectMap& map, const TexelMap& texels, const Run& run)
    : mesh_(mesh),
      patchOf_(std::size_t(map.width) * std::size_t(map.height), kNone),
      offset_m_(patchOf_.size(), glm::vec3(0.0f)),
      moments_(mesh.patches.size()) {
  parallelFor(run, texels.tileCount(), 1, [&](std::size_t tileIndex) {
    const TexelTile tile = texels.texels(tileIndex);
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        if (tile.at(x, y).fragmentCount == 0) continue;
        const SurfacePoint p = TexelSampler(scene, tile, tile.at(x, y)).at({0.5f, 0.5f});
        const std::size_t i = std::size_t(tile.y0 + y) * std::size_t(map.width) + std::size_t(tile.x0 + x);
        patchOf_[i] = mesh.patchAt(p.triangle, p.bary, true);
        if (patchOf_[i] != kNone) offset_m_[i] = glm::vec3(p.position_m - mesh.patches[patchOf_[i]].centre_m);
      }
  });
  std::unordered_set<std::uint64_t> known;
  const auto meet = [&](std::size_t i, std::size_t k) {
    const std::uint32_t a = patchOf_[i], b = patchOf_[k];
    if (a == b || a == kNone || b == kNone || map.chart[i] != map.chart[k]) return;
    if (known.insert((std::uint64_t(std::min(a, b)) << 32) | std::max(a, b)).second) pairs_.push_back({a, b});
  };
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x) {
      const std::size_t i = std::size_t(y) * std::size_t(map.width) + std::size_t(x);
      if (x + 1 < map.width) meet(i, i + 1);
      if (y + 1 < map.height) meet(i, i + std::size_t(map.width));
    }
  std::vector<glm::dmat3> sums(moments_.size(), glm::dmat3(0.0));
  for (const auto& [a, b] : pairs_) {
    const glm::dmat3 m = glm::outerProduct(towards(a, b), towards(a, b));
    sums[a] += m;
    sums[b] += m;
  }
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const double trace = sums[i][0][0] + sums[i][1][1] + sums[i][2][2];
    if (trace > 0.0) moments_[i] = {glm::inverse(sums[i] + kRidge * trace * glm::dmat3(1.0)), true};
  }
}

std::vector<Rgb> Slopes::overTexels(const std::vector<Rgb>& ofPatches) const {
  std::vector<glm::dmat3> right(ofPatches.size(), glm::dmat3(0.0));
  for (const auto& [a, b] : pairs_) {
    const glm::dmat3 m = glm::outerProduct(towards(a, b), glm::dvec3(ofPatches[b]) - glm::dvec3(ofPatches[a]));
    right[a] += m;  // both change sign from b to a
    right[b] += m;
  }
  std::vector<glm::mat3> slope(ofPatches.size(), glm::mat3(0.0f));  // change per metre, a column a channel
  for (std::size_t i = 0; i < slope.size(); ++i)
    if (moments_[i].known) slope[i] = glm::mat3(moments_[i].inverse * right[i]);
  std::vector<Rgb> out(patchOf_.size(), Rgb(0.0f));
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (patchOf_[i] == kNone) continue;
    const Rgb mean = ofPatches[patchOf_[i]];
    out[i] = glm::clamp(mean + offset_m_[i] * slope[patchOf_[i]], Rgb(0.0f), 2.0f * mean);  // row vector: a product for each column
  }
  return out;
}

}  // namespace lmc
