#include "libradiosity/slopes.h"

#include <numeric>
#include <unordered_set>

#include "libscene/parallel.h"

namespace lmc {

namespace {

constexpr double kRidge =
    0.02;  // of the moments' trace: neighbours along one line say nothing of the other direction, where the slope is none

}  // namespace

TexelPatches::TexelPatches(const Scene& scene, const PatchMesh& mesh, const TexelMap& texels, const Run& run)
    : patch(std::size_t(texels.width()) * std::size_t(texels.height()), kNone), position_m(patch.size()) {
  parallelFor(run, texels.tileCount(), 1, [&](std::size_t tileIndex) {
    const auto held = texels.held(tileIndex);
    const TexelTile& tile = *held;
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        if (tile.at(x, y).fragmentCount == 0) continue;
        const SurfacePoint p = TexelSampler(scene, tile, tile.at(x, y)).middle();
        const std::size_t i = std::size_t(tile.y0 + y) * std::size_t(texels.width()) + std::size_t(tile.x0 + x);
        patch[i] = mesh.patchAt(p.triangle, p.bary, true);
        position_m[i] = glm::vec3(p.position_m);
      }
  });
}

PatchGroups singlePatches(const PatchMesh& mesh) {
  PatchGroups out{std::vector<std::uint32_t>(mesh.patches.size()), std::uint32_t(mesh.patches.size())};
  std::iota(out.of.begin(), out.of.end(), 0u);
  return out;
}

Slopes::Slopes(const PatchMesh& mesh, const DirectMap& map, const TexelPatches& texels, const PatchGroups& groups)
    : mesh_(mesh), texels_(texels), groups_(groups), centre_m_(groups.count, glm::dvec3(0.0)), moments_(groups.count) {
  std::vector<double> area(groups.count, 0.0);
  for (std::size_t i = 0; i < mesh.patches.size(); ++i) {
    // A patch that is all buried still has a place.
    const double a = std::max(mesh.patches[i].area_m2, 1e-9 * mesh.patches[i].radius_m * mesh.patches[i].radius_m);
    centre_m_[groups.of[i]] += a * mesh.patches[i].centre_m;
    area[groups.of[i]] += a;
  }
  for (std::size_t g = 0; g < area.size(); ++g)
    if (area[g] > 0.0) centre_m_[g] /= area[g];
  std::unordered_set<std::uint64_t> known;
  const auto meet = [&](std::size_t i, std::size_t k) {
    if (texels.patch[i] == kNone || texels.patch[k] == kNone || map.chart[i] != map.chart[k]) return;
    const std::uint32_t a = groups.of[texels.patch[i]], b = groups.of[texels.patch[k]];
    if (a == b) return;
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
    const glm::dvec3 d = centre_m_[b] - centre_m_[a];
    sums[a] += glm::outerProduct(d, d);
    sums[b] += glm::outerProduct(d, d);
  }
  for (std::size_t i = 0; i < sums.size(); ++i) {
    const double trace = sums[i][0][0] + sums[i][1][1] + sums[i][2][2];
    if (trace > 0.0) moments_[i] = {glm::inverse(sums[i] + kRidge * trace * glm::dmat3(1.0)), true};
  }
}

std::vector<Rgb> Slopes::means(const std::vector<Rgb>& ofPatches) const {
  std::vector<glm::dvec3> sum(groups_.count, glm::dvec3(0.0));
  std::vector<double> area(groups_.count, 0.0);
  std::vector<Rgb> out(groups_.count, Rgb(0.0f));
  for (std::size_t i = ofPatches.size(); i-- > 0;) {
    const std::uint32_t g = groups_.of[i];
    sum[g] += mesh_.patches[i].area_m2 * glm::dvec3(ofPatches[i]);
    area[g] += mesh_.patches[i].area_m2;
    out[g] = ofPatches[i];
  }
  for (std::size_t g = 0; g < out.size(); ++g)
    if (area[g] > 0.0) out[g] = Rgb(sum[g] / area[g]);
  return out;
}

Sloped Slopes::of(std::vector<Rgb> means) const {
  std::vector<glm::dmat3> right(means.size(), glm::dmat3(0.0));
  for (const auto& [a, b] : pairs_) {
    const glm::dmat3 m = glm::outerProduct(centre_m_[b] - centre_m_[a], glm::dvec3(means[b]) - glm::dvec3(means[a]));
    right[a] += m;  // both factors change sign from b to a
    right[b] += m;
  }
  Sloped out{std::move(means), std::vector<glm::mat3>(right.size(), glm::mat3(0.0f))};
  for (std::size_t g = 0; g < right.size(); ++g)
    if (moments_[g].known) out.slope[g] = glm::mat3(moments_[g].inverse * right[g]);
  return out;
}

Rgb Slopes::at(const Sloped& values, std::size_t texel) const {
  const std::uint32_t g = groups_.of[texels_.patch[texel]];
  const glm::vec3 offset_m = texels_.position_m[texel] - glm::vec3(centre_m_[g]);
  return glm::clamp(values.mean[g] + offset_m * values.slope[g], Rgb(0.0f),
                    2.0f * values.mean[g]);  // row vector: a product for each column
}

}  // namespace lmc
