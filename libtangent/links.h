#pragma once
/// Who is whose neighbour round one vertex. All triangles at an edge meet in the ring of either of its ends, so a ring knows all its links.
#include "libtangent/rings.h"

namespace lmc::tangent {

inline constexpr std::uint32_t kNobody = ~0u;

/// Per place in the ring: the place across the side that leaves the vertex (to the next corner), and across the one that comes to it.
struct Across {
  std::uint32_t leaving = kNobody, coming = kNobody;
};

/// Sides at the vertex, reused from ring to ring: the id at the far end, the place, and whether the side leaves, in one word that sorts so.
using LinkScratch = std::vector<std::uint64_t>;

/// An edge's triangles pair in ascending order, each with the first later one that runs the other way and is free: the pairing is the same
/// seen from either end. Sides of more than two triangles are allowed. O(n log n).
void linkRing(const Mesh&, std::span<const RingCorner> ring, LinkScratch&, std::vector<Across>& across);

/// Gives every frameless triangle the orientation of the first group that reaches it. Groups start in ascending order of corners; where all
/// triangles round a frameless one agree, order does not matter and nothing is followed.
void orientFrameless(const Mesh&, const Rings&, Frames&);

}  // namespace lmc::tangent
