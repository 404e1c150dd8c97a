#include "libtangent/rings.h"

#include <algorithm>

namespace lmc::tangent {

namespace {

constexpr std::size_t kMaxParts = 8;         // each counts for itself: 4 bytes per id
constexpr std::size_t kLeastPart = 1 << 15;  // triangles that are worth a part
constexpr std::size_t kIdGrain = 1 << 16;

template <class Visit>
void forCorners(const Mesh& m, const Frames& frames, std::size_t first, std::size_t last, const Visit& visit) {
  const std::uint32_t* id = m.ids.data() + 3 * first;
  const bool all = frames.degenerate.empty();
  for (std::size_t t = first; t < last; ++t, id += 3) {
    if (!all && (frames.of[t].flags & kDegenerate)) continue;
    visit(id[0], ringCorner(t, 0));
    visit(id[1], ringCorner(t, 1));
    visit(id[2], ringCorner(t, 2));
  }
}

}  // namespace

// A counting sort in parts of ascending triangles. Part p of an id's ring begins where part p - 1 ends, so that the outcome is the same
// for any number of parts.
Rings ringsOf(const Mesh& m, const Frames& frames, const Loop& loop) {
  Rings rings;
  const std::size_t triangles = m.triangleCount(), ids = m.vertices.size();
  const std::size_t threads = loop.each ? std::size_t(std::max(1, loop.threads)) : 1;
  const std::size_t parts = std::clamp<std::size_t>(triangles / kLeastPart, 1, std::min(threads, kMaxParts));
  const std::size_t size = (triangles + parts - 1) / parts;
  std::vector<Array<std::uint32_t>> count(parts);
  pieces(loop, triangles, std::max<std::size_t>(1, size), [&](std::size_t a, std::size_t b) {
    Array<std::uint32_t>& mine = count[a / size];
    mine.assign(ids, 0);
    forCorners(m, frames, a, b, [&](std::uint32_t id, RingCorner) { ++mine[id]; });
  });
  if (triangles == 0) count[0].assign(ids, 0);

  // Totals of stretches of ids, then the places within each.
  std::vector<std::uint32_t> stretch((ids + kIdGrain - 1) / kIdGrain + 1, 0);
  pieces(loop, ids, kIdGrain, [&](std::size_t a, std::size_t b) {
    std::uint32_t sum = 0;
    for (const Array<std::uint32_t>& c : count)
      for (std::size_t v = a; v < b; ++v) sum += c[v];
    stretch[a / kIdGrain + 1] = sum;
  });
  for (std::size_t i = 1; i < stretch.size(); ++i) stretch[i] += stretch[i - 1];
  rings.start.resize(ids + 1);
  rings.start[ids] = stretch.back();
  pieces(loop, ids, kIdGrain, [&](std::size_t a, std::size_t b) {
    std::uint32_t at = stretch[a / kIdGrain];
    for (std::size_t v = a; v < b; ++v) {
      rings.start[v] = at;
      for (Array<std::uint32_t>& c : count) at += std::exchange(c[v], at);
    }
  });

  rings.corners.resize(stretch.back() + Rings::kAhead);
  std::fill(rings.corners.end() - Rings::kAhead, rings.corners.end(), 0);
  pieces(loop, triangles, std::max<std::size_t>(1, size), [&](std::size_t a, std::size_t b) {
    std::uint32_t* place = count[a / size].data();
    forCorners(m, frames, a, b, [&](std::uint32_t id, RingCorner c) { rings.corners[place[id]++] = c; });
  });
  return rings;
}

}  // namespace lmc::tangent
