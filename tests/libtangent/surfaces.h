#pragma once
/// Surfaces that the tests of tangents share.
#include <cmath>
#include <cstring>
#include <random>

#include "libtangent/tangent.h"
#include "tests/libtangent/reference_meshes.h"

namespace lmc::tangent {

struct OwnedSurface {
  std::vector<glm::vec3> positions, normals;
  std::vector<glm::vec2> uvs;
  std::vector<std::uint32_t> indices;
  std::vector<std::uint8_t> faceSizes;

  Surface view() const { return {positions, normals, uvs, indices, faceSizes}; }
  std::uint32_t add(glm::vec3 p, glm::vec3 n, glm::vec2 uv) {
    positions.push_back(p);
    normals.push_back(n);
    uvs.push_back(uv);
    return std::uint32_t(positions.size() - 1);
  }
};

inline OwnedSurface ownedOf(const ReferenceMesh& m) {
  constexpr float kStep = 1.0f / 4096;
  OwnedSurface s;
  for (std::size_t v = 0; v < m.positions.size(); ++v) {
    const auto &p = m.positions[v], &n = m.normals[v];
    s.add(kStep * glm::vec3(p[0], p[1], p[2]), kStep * glm::vec3(n[0], n[1], n[2]), kStep * glm::vec2(m.uvs[v][0], m.uvs[v][1]));
  }
  s.indices = m.indices;
  s.faceSizes = m.faceSizes;
  return s;
}

/// One square in the plane of X and Y, normal +Z, U along +X and V along +Y, or U along -X.
inline OwnedSurface square(bool mirrored = false) {
  OwnedSurface s;
  for (const glm::vec2 at : {glm::vec2(0, 0), glm::vec2(1, 0), glm::vec2(1, 1), glm::vec2(0, 1)})
    s.add({at, 0.0f}, {0, 0, 1}, {mirrored ? 1.0f - at.x : at.x, at.y});
  s.indices = {0, 1, 2, 0, 2, 3};
  return s;
}

/// A sphere in `columns` by `rows`, U seam split, a vertex of its own for each corner at a pole.
inline OwnedSurface sphere(int columns, int rows) {
  OwnedSurface s;
  const auto vertex = [&](double u, double v) {
    const double phi = 2.0 * 3.14159265358979 * u, theta = 3.14159265358979 * v;
    const glm::vec3 p(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi));
    return s.add(p, p, glm::vec2(8.0 * u, 4.0 * v));
  };
  for (int j = 1; j < rows; ++j)
    for (int i = 0; i <= columns; ++i) vertex(double(i) / columns, double(j) / rows);
  const auto at = [&](int i, int j) { return std::uint32_t((j - 1) * (columns + 1) + i); };
  const auto face = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) { s.indices.insert(s.indices.end(), {a, b, c}); };
  for (int i = 0; i < columns; ++i) {
    face(vertex((i + 0.5) / columns, 0.0), at(i + 1, 1), at(i, 1));
    for (int j = 1; j + 1 < rows; ++j) {
      face(at(i, j), at(i + 1, j), at(i + 1, j + 1));
      face(at(i, j), at(i + 1, j + 1), at(i, j + 1));
    }
    face(vertex((i + 0.5) / columns, 1.0), at(i, rows - 1), at(i + 1, rows - 1));
  }
  return s;
}

/// Triangles round one vertex. `polar`: U goes round with them, so that tangents point everywhere.
inline OwnedSurface fan(int triangles, bool polar = false) {
  OwnedSurface s;
  s.add({0, 0, 0}, {0, 0, 1}, polar ? glm::vec2(0.5f, 0.0f) : glm::vec2(0.0f));
  for (int i = 0; i < triangles; ++i) {
    const double a = 2.0 * 3.14159265358979 * i / triangles;
    const glm::vec2 at(std::cos(a), std::sin(a));
    s.add({at, 0.01f * float(std::sin(7 * a))}, {0, 0, 1}, polar ? glm::vec2(float(i) / float(triangles), 1.0f) : at);
  }
  for (int i = 0; i < triangles; ++i) s.indices.insert(s.indices.end(), {0u, std::uint32_t(1 + i), std::uint32_t(1 + (i + 1) % triangles)});
  return s;
}

/// Anything: few vertices on a lattice, shared by many faces, quads and degenerate ones among them.
inline OwnedSurface soup(std::uint32_t seed) {
  std::mt19937 numbers(seed);
  const auto below = [&](std::uint32_t n) { return numbers() % n; };
  const auto lattice = [&] { return float(below(3)) - 1.0f; };
  const auto anywhere = [&] { return float(below(20001)) / 10000.0f - 1.0f; };
  OwnedSurface s;
  const bool onLattice = below(2), flat = below(3) == 0, quads = below(3) == 0;
  const std::uint32_t vertices = 3 + below(30), faces = 1 + below(80);
  for (std::uint32_t v = 0; v < vertices; ++v) {
    const auto number = [&] { return onLattice ? lattice() : anywhere(); };
    const glm::vec3 p(number(), number(), number());
    glm::vec3 n(number(), number(), number());
    if (flat || glm::dot(n, n) == 0.0f) n = {0, 0, 1};
    s.add(p, below(9) ? glm::normalize(n) : n, {number(), number()});
  }
  for (std::uint32_t f = 0; f < faces; ++f) {
    const std::uint8_t size = quads && below(2) ? 4 : 3;
    if (quads) s.faceSizes.push_back(size);
    for (int c = 0; c < size; ++c) s.indices.push_back(below(vertices));
  }
  return s;
}

inline bool sameBits(const void* a, const void* b, std::size_t bytes) { return bytes == 0 || std::memcmp(a, b, bytes) == 0; }

/// What every tangent in a file must be, whatever the surface: the first corner that is not, or -1.
inline std::ptrdiff_t firstUnfit(const OwnedSurface& s, const Tangents& got) {
  for (std::size_t c = 0; c < s.indices.size(); ++c) {
    const glm::vec3 t = got.corners[c].tangent, n = s.normals[s.indices[c]];
    const bool unit = std::abs(glm::length(t) - 1.0f) <= 1e-5f, sign = std::abs(got.corners[c].determinant) == 1.0f;
    const bool orthogonal = !(std::abs(glm::length(n) - 1.0f) < 1e-3f) || std::abs(glm::dot(n, t)) <= 1e-3f;
    if (!unit || !sign || !orthogonal) return std::ptrdiff_t(c);
  }
  return -1;
}

}  // namespace lmc::tangent
