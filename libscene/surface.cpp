#include "libscene/surface.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "libscene/constants.h"
#include "libscene/rng.h"

namespace lmc {

namespace {

const double kCreaseCos = std::cos(30.0 * kPi / 180.0);
const double kSharpCos = std::cos(75.0 * kPi / 180.0);
const double kSameNormalCos = std::cos(8.0 * kPi / 180.0);

/// The first vertex at the place of each, by exact position.
std::vector<std::uint32_t> weld(const Scene& scene, const Object& o) {
  const auto key = [&](std::uint32_t v) {
    const glm::vec3 p = scene.positions_m[o.firstVertex + v] + 0.0f;  // -0 and 0 are one place
    return std::array{std::bit_cast<std::uint32_t>(p.x), std::bit_cast<std::uint32_t>(p.y), std::bit_cast<std::uint32_t>(p.z)};
  };
  std::vector<std::pair<std::array<std::uint32_t, 3>, std::uint32_t>> sorted;
  sorted.reserve(o.vertexCount);
  for (std::uint32_t v = 0; v < o.vertexCount; ++v) sorted.emplace_back(key(v), v);
  std::ranges::sort(sorted);
  std::vector<std::uint32_t> first(o.vertexCount);
  for (std::size_t i = 0; i < sorted.size();) {
    const std::size_t begin = i;
    for (; i < sorted.size() && sorted[i].first == sorted[begin].first; ++i) first[sorted[i].second] = sorted[begin].second;
  }
  return first;
}

struct HalfEdge {
  std::uint64_t ends;  // the lower place first
  std::uint32_t face;
  std::uint8_t edge;
  bool forward;  // from the lower to the higher
  bool operator<(const HalfEdge& o) const { return ends != o.ends ? ends < o.ends : face != o.face ? face < o.face : edge < o.edge; }
};

}  // namespace

Surface surfaceOf(const Scene& scene, const Object& o) {
  Surface s;
  const std::vector<std::uint32_t> first = weld(scene, o);
  std::vector<std::uint32_t> placeOf(o.vertexCount, kNone);
  for (std::uint32_t v = 0; v < o.vertexCount; ++v) {
    if (first[v] == v) {
      placeOf[v] = std::uint32_t(s.positions_m.size());
      s.positions_m.push_back(glm::dvec3(scene.positions_m[o.firstVertex + v]));
    }
  }
  std::vector<HalfEdge> edges;
  edges.reserve(3 * std::size_t(o.triangleCount));
  for (std::uint32_t f = 0; f < o.triangleCount; ++f) {
    const glm::uvec3 v = scene.triangles[o.firstTriangle + f] - o.firstVertex;
    const glm::uvec3 t(placeOf[first[v.x]], placeOf[first[v.y]], placeOf[first[v.z]]);
    s.triangles.push_back(t);
    const glm::dvec3 a = s.positions_m[t.x], b = s.positions_m[t.y], c = s.positions_m[t.z];
    const glm::dvec3 n = glm::cross(b - a, c - a);
    const double length = glm::length(n);
    s.normals.push_back(length > 0.0 ? n / length : glm::dvec3(0.0));
    s.areas_m2.push_back(0.5 * length);
    s.centres_m.push_back((a + b + c) / 3.0);
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t p = t[k], q = t[(k + 1) % 3];
      edges.push_back({std::uint64_t(std::min(p, q)) << 32 | std::max(p, q), f, std::uint8_t(k), p < q});
    }
  }
  std::sort(edges.begin(), edges.end());

  // Normal of a face's corner that begins its edge k.
  const auto cornerNormal = [&](const HalfEdge& e, bool end) {
    return glm::dvec3(scene.normals[scene.triangles[o.firstTriangle + e.face][(e.edge + (end ? 1 : 0)) % 3]]);
  };
  s.neighbours.assign(o.triangleCount, {kNone, kNone, kNone});
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t end = i + 1;
    while (end < edges.size() && edges[end].ends == edges[i].ends) ++end;
    const HalfEdge &a = edges[i], &b = edges[std::min(i + 1, edges.size() - 1)];
    if (end - i == 2 && a.forward != b.forward && a.face != b.face) {
      const double turn = glm::dot(s.normals[a.face], s.normals[b.face]);
      const bool sameNormals = glm::dot(cornerNormal(a, false), cornerNormal(b, true)) > kSameNormalCos &&
                               glm::dot(cornerNormal(a, true), cornerNormal(b, false)) > kSameNormalCos;
      if (turn > kCreaseCos || (sameNormals && turn > kSharpCos)) {
        s.neighbours[a.face][a.edge] = b.face;
        s.neighbours[b.face][b.edge] = a.face;
      }
    }
    i = end;
  }
  return s;
}

}  // namespace lmc
