#include "libradiosity/emitters.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <queue>
#include <set>
#include <tuple>

#include "libscene/rng.h"
#include "libscene/texture.h"
#include "libscene/tracer.h"

namespace lmc {

namespace {

constexpr double kSmallestPiece = 1.0 / 64.0;  // of the level's extent: smaller pieces gain nothing that a shadow ray would see

double longestEdge_m(const Emitter& e, int& edge) {
  double longest = -1.0;
  for (int k = 0; k < 3; ++k) {
    const double l = glm::distance(e.corner_m[std::size_t(k)], e.corner_m[std::size_t((k + 1) % 3)]);
    if (l > longest) {
      longest = l;
      edge = k;
    }
  }
  return longest;
}

constexpr std::uint32_t kTexturePlaces = 1024;  // on each piece, for its mean

/// What a place sends out: nothing in the holes of a Mask material.
Rgb shiningAt(const Scene& scene, std::uint32_t triangle, glm::vec2 bary) {
  const Material& m = scene.materialOf(triangle);
  if (m.alpha == Material::Alpha::Mask && alphaAt(scene, triangle, bary) < m.alphaCutoff) return Rgb(0.0f);
  return emissionAt(scene, triangle, bary);
}

Rgb meanRadiance(const Scene& scene, const Emitter& e) {
  const Sobol4 numbers(combine(e.triangle, 11));
  glm::dvec3 sum(0.0);
  for (std::uint32_t k = 0; k < kTexturePlaces; ++k) {
    const glm::vec2 u = numbers.point2(k);
    const float s = std::sqrt(u.x);
    sum += glm::dvec3(
        shiningAt(scene, e.triangle, e.bary[0] + s * (1.0f - u.y) * (e.bary[1] - e.bary[0]) + s * u.y * (e.bary[2] - e.bary[0])));
  }
  return Rgb(sum / double(kTexturePlaces));
}

/// Faces that stand twice in a level, as exporters and careless copies leave them, shine once.
class Doubles {
 public:
  /// Whether a triangle of the same corners in the same order came before.
  bool isOne(const Scene& scene, std::uint32_t triangle) {
    const glm::uvec3 t = scene.triangles[triangle];
    std::array<glm::vec3, 3> c{scene.positions_m[t.x], scene.positions_m[t.y], scene.positions_m[t.z]};
    const auto before = [](const glm::vec3& a, const glm::vec3& b) { return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z); };
    std::ranges::rotate(c, std::ranges::min_element(c, before));
    const auto key = std::bit_cast<std::array<float, 9>>(c);
    return !known_.insert(key).second;
  }

 private:
  std::set<std::array<float, 9>> known_;
};

}  // namespace

Emitters findEmitters(const Scene& scene, std::size_t maxPieces) {
  std::vector<Emitter> emitters;
  Doubles doubles;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    const Material& material = scene.materialOf(t);
    if (strength(material.emission) <= 0.0f || isDegenerate(scene.corners_m(t)) || doubles.isOne(scene, t)) continue;
    Emitter e;
    e.triangle = t;
    e.bary = {glm::vec2(0, 0), glm::vec2(1, 0), glm::vec2(0, 1)};
    e.corner_m = scene.corners_m(t);
    e.area_m2 = area_m2(e.corner_m);
    e.normal = glm::normalize(glm::cross(e.corner_m[1] - e.corner_m[0], e.corner_m[2] - e.corner_m[0]));
    e.textured = bool(material.emissionTexture) || material.alpha == Material::Alpha::Mask;
    e.radiance = material.emission;
    emitters.push_back(e);
    if (material.doubleSided) {
      std::swap(e.corner_m[1], e.corner_m[2]);
      std::swap(e.bary[1], e.bary[2]);
      e.normal = -e.normal;
      emitters.push_back(e);
    }
  }
  for (Emitter& e : emitters) {
    int longest = 0;
    e.longest2_m2 = std::pow(longestEdge_m(e, longest), 2.0);
  }
  Emitters out;
  for (Emitter& e : emitters)
    if (!e.textured) {
      e.whole = std::uint32_t(out.whole.size());
      out.whole.push_back(e);
    }
  const double smallest = 2.0 * double(scene.extent_m) * kSmallestPiece;
  std::priority_queue<std::pair<double, std::size_t>> queue;
  int edge = 0;
  for (std::size_t i = 0; i < emitters.size(); ++i) queue.emplace(longestEdge_m(emitters[i], edge), i);
  while (!queue.empty() && emitters.size() < maxPieces && queue.top().first > smallest) {
    const std::size_t i = queue.top().second;
    queue.pop();
    longestEdge_m(emitters[i], edge);
    const auto a = std::size_t(edge), b = std::size_t((edge + 1) % 3);
    Emitter other = emitters[i];
    const glm::dvec3 mid = 0.5 * (other.corner_m[a] + other.corner_m[b]);
    const glm::vec2 midBary = 0.5f * (other.bary[a] + other.bary[b]);
    emitters[i].corner_m[b] = other.corner_m[a] = mid;
    emitters[i].bary[b] = other.bary[a] = midBary;
    emitters[i].area_m2 = other.area_m2 = 0.5 * other.area_m2;
    emitters.push_back(other);
    queue.emplace(longestEdge_m(emitters[i], edge), i);
    queue.emplace(longestEdge_m(other, edge), emitters.size() - 1);
  }
  // A textured piece shines evenly, by its own mean: seen from farther than its size that is no difference, and nothing is left to chance.
  for (Emitter& e : emitters) {
    if (e.textured) {
      e.radiance = meanRadiance(scene, e);
      e.longest2_m2 = std::pow(longestEdge_m(e, edge), 2.0);
    }
    if (strength(e.radiance) <= 0.0f) continue;
    if (e.textured) {
      e.whole = std::uint32_t(out.whole.size());
      out.whole.push_back(e);
    }
    out.pieces.push_back(e);
  }
  std::ranges::stable_sort(out.pieces, {}, &Emitter::whole);
  for (std::uint32_t i = 0; i < out.pieces.size(); ++i) {
    Emitter& whole = out.whole[out.pieces[i].whole];
    if (whole.pieceCount++ == 0) whole.firstPiece = i;
  }
  return out;
}

}  // namespace lmc
