#pragma once
/// The surface as triangles over welded vertices: what every later step reads.
#include "libtangent/tangent.h"

namespace lmc::tangent {

/// What a corner takes from its vertex: half a cache line, in two vectors of four.
struct alignas(32) Vertex {
  glm::vec3 position;
  float u;
  glm::vec3 normal;
  float v;
};

struct Mesh {
  Array<Vertex> vertices;              ///< per id
  std::span<const std::uint32_t> ids;  ///< 3 per triangle; corners weld exactly where ids are equal
  std::size_t welded = 0;              ///< vertices that gave up their own id

  std::size_t triangleCount() const { return ids.size() / 3; }
  bool hasQuads() const { return !slots.empty(); }
  std::uint32_t slotOf(std::size_t triangle, std::uint32_t corner) const {
    return hasQuads() ? slots[3 * triangle + corner] : std::uint32_t(3 * triangle + corner);
  }
  std::uint32_t faceOf(std::size_t triangle) const { return hasQuads() ? faces[triangle] : std::uint32_t(triangle); }

  std::vector<std::uint32_t> slots;  ///< 3 per triangle: corner of the surface; empty = all triangles, one after the other
  std::vector<std::uint32_t> faces;  ///< per triangle; empty as slots

  Array<std::uint32_t> ownIds;  ///< what `ids` looks at when it is not the caller's
};

/// Splits quads along the diagonal shorter in UV (then in space, then 0-2) and welds vertices of equal position, normal and UV: equal as
/// numbers, so that +0 is -0 and a vertex with a NaN is equal to none, its other corners included.
Mesh meshOf(const Surface&, const Loop&);

/// body(first, last) over [0, n) in pieces of `grain`.
template <class Body>
void pieces(const Loop& loop, std::size_t n, std::size_t grain, const Body& body) {
  const std::size_t count = (n + grain - 1) / grain;
  const auto piece = [&](std::size_t i) { body(i * grain, std::min(n, (i + 1) * grain)); };
  if (loop.each && loop.threads > 1 && count > 1)
    loop.each(count, piece);
  else
    for (std::size_t i = 0; i < count; ++i) piece(i);
}

}  // namespace lmc::tangent
