#include "libtangent/mesh.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>

#include "libtangent/four.h"

namespace lmc::tangent {

namespace {

constexpr std::size_t kGrain = 16384;  // vertices or corners a piece
constexpr std::size_t kAhead = 64;     // vertices hashed before the first of them is looked up, so that the table is in the cache

Vertex vertexOf(const Surface& s, std::size_t v) { return {s.positions[v], s.uvs[v].x, s.normals[v], s.uvs[v].y}; }

/// A vertex as two vectors of numbers.
struct Key {
  explicit Key(const Vertex& v) : low(loadFour(&v.position.x)), high(loadFour(&v.normal.x)) {}
  Four low, high;
};
bool operator==(const Key& a, const Key& b) { return bitsOf((a.low == b.low) & (a.high == b.high)) == 15; }
bool isNan(const Key& k) { return bitsOf((k.low == k.low) & (k.high == k.high)) != 15; }

std::uint32_t hashOf(const Key& k) {
  const Four low = k.low + 0.0f, high = k.high + 0.0f;  // -0 + 0 is +0
  std::uint64_t word[4];
  std::memcpy(word, &low, sizeof low);
  std::memcpy(word + 2, &high, sizeof high);
  std::uint64_t a = word[0] * 0x9e3779b97f4a7c15u, b = word[1] * 0xc2b2ae3d27d4eb4fu;
  const std::uint64_t c = word[2] * 0x165667b19e3779f9u, d = word[3] * 0x27d4eb2f165667c5u;
  a ^= a >> 32, b ^= b >> 29;
  std::uint64_t h = (a + (c ^ c >> 31)) * 0xff51afd7ed558ccdu ^ (b + (d ^ d >> 33)) * 0xc4ceb9fe1a85ec53u;
  h ^= h >> 32;
  return std::uint32_t((h * 0x9e3779b97f4a7c15u) >> 32);
}

/// An open-addressed set of vertices, each with its hash in the upper half of its slot. Equal ones end up in one slot, which holds the
/// smallest of them in the end whatever the order in which they came: threads may put in side by side.
class VertexSet {
 public:
  VertexSet(const Array<Vertex>& vertices, const Loop& loop)
      : vertices_(vertices), bits_(std::max(4, int(std::bit_width(2 * vertices.size())))) {
    table_.resize(std::size_t(1) << bits_);
    pieces(loop, table_.size(), kGrain * 4, [&](std::size_t a, std::size_t b) { std::fill(&table_[a], &table_[a] + (b - a), kEmpty); });
  }

  /// What a stretch of vertices brought.
  struct Found {
    std::size_t equals = 0;  ///< how many found an equal one there
    bool nan = false;        ///< whether one had a NaN; such are in no slot, and keep themselves as their slot's number
  };

  /// Puts vertices [first, last) in, and notes the slot of each.
  template <bool kShared>
  Found put(std::size_t first, std::size_t last, std::uint32_t* slotOf) {
    Found found;
    std::uint32_t hash[kAhead];
    for (std::size_t at = first; at < last; at += kAhead) {
      const std::size_t n = std::min(kAhead, last - at);
      for (std::size_t i = 0; i < n; ++i) {
        hash[i] = hashOf(Key(vertices_[at + i]));
        __builtin_prefetch(&table_[hash[i] >> (32 - bits_)], 1);
      }
      for (std::size_t i = 0; i < n; ++i) {
        if (isNan(Key(vertices_[at + i]))) [[unlikely]]
          found.nan = true;
        else
          slotOf[at + i] = putOne<kShared>(std::uint32_t(at + i), hash[i], found.equals);
      }
    }
    return found;
  }
  std::uint32_t at(std::uint32_t slot) const { return std::uint32_t(table_[slot]); }

 private:
  static constexpr std::uint64_t kEmpty = ~std::uint64_t(0);  // no vertex: problemWith() keeps their number below it

  template <bool kShared>
  std::uint32_t putOne(std::uint32_t vertex, std::uint32_t hash, std::size_t& equals) {
    const std::uint32_t mask = std::uint32_t(table_.size() - 1);
    const std::uint64_t mine = std::uint64_t(hash) << 32 | vertex;
    for (std::uint32_t slot = hash >> (32 - bits_);; slot = (slot + 1) & mask) {
      if constexpr (kShared) {
        std::atomic_ref<std::uint64_t> place(table_[slot]);
        std::uint64_t there = place.load(std::memory_order_relaxed);
        if (there == kEmpty && place.compare_exchange_strong(there, mine, std::memory_order_relaxed)) return slot;
        if ((there ^ mine) >> 32 || !(Key(vertices_[std::uint32_t(there)]) == Key(vertices_[vertex]))) continue;
        while (mine < there && !place.compare_exchange_weak(there, mine, std::memory_order_relaxed)) {
        }
      } else {
        const std::uint64_t there = table_[slot];
        if (there == kEmpty) {
          table_[slot] = mine;
          return slot;
        }
        if ((there ^ mine) >> 32 || !(Key(vertices_[std::uint32_t(there)]) == Key(vertices_[vertex]))) continue;
      }
      ++equals;
      return slot;
    }
  }

  const Array<Vertex>& vertices_;
  int bits_;
  Array<std::uint64_t> table_;
};

struct Weld {
  Array<std::uint32_t> id;  ///< of each vertex: the smallest vertex equal to it; empty when all differ
  std::size_t welded = 0;
  bool nan = false;  ///< some vertex has a NaN
};
Weld weld(const Array<Vertex>& vertices, const Loop& loop) {
  const std::size_t n = vertices.size();
  VertexSet set(vertices, loop);
  Weld out;
  out.id.resize(n);
  std::atomic<std::size_t> equals{0};
  std::atomic<bool> nan{false};
  const bool shared = loop.each && loop.threads > 1;
  pieces(loop, n, kGrain, [&](std::size_t a, std::size_t b) {
    const VertexSet::Found found = shared ? set.put<true>(a, b, out.id.data()) : set.put<false>(a, b, out.id.data());
    equals += found.equals;
    if (found.nan) nan = true;
  });
  out.welded = equals;
  out.nan = nan;
  if (out.welded == 0) {
    out.id.clear();
    return out;
  }
  pieces(loop, n, kGrain, [&](std::size_t a, std::size_t b) {
    for (std::size_t v = a; v < b; ++v) out.id[v] = isNan(Key(vertices[v])) ? std::uint32_t(v) : set.at(out.id[v]);
  });
  return out;
}

float squaredLength(glm::vec2 v) { return v.x * v.x + v.y * v.y; }

/// Corner numbers, within the face, of its one or two triangles.
void splitQuads(const Surface& s, Mesh& mesh) {
  std::uint32_t start = 0;
  for (std::size_t f = 0; f < s.faceSizes.size(); start += s.faceSizes[f++]) {
    const auto add = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      mesh.slots.insert(mesh.slots.end(), {start + a, start + b, start + c});
      mesh.faces.push_back(std::uint32_t(f));
    };
    if (s.faceSizes[f] == 3) add(0, 1, 2);
    if (s.faceSizes[f] != 4) continue;
    const std::uint32_t* v = &s.indices[start];
    const float uv02 = squaredLength(s.uvs[v[2]] - s.uvs[v[0]]), uv13 = squaredLength(s.uvs[v[3]] - s.uvs[v[1]]);
    const glm::vec3 p02 = s.positions[v[2]] - s.positions[v[0]], p13 = s.positions[v[3]] - s.positions[v[1]];
    const bool along02 = uv02 < uv13 || (!(uv13 < uv02) && !(glm::dot(p13, p13) < glm::dot(p02, p02)));
    if (along02)
      add(0, 1, 2), add(0, 2, 3);
    else
      add(0, 1, 3), add(1, 2, 3);
  }
}

/// A vertex of its own for every corner whose vertex has a NaN.
void partNans(Mesh& mesh) {
  for (std::uint32_t& id : mesh.ownIds) {
    const Vertex vertex = mesh.vertices[id];
    if (!isNan(Key(vertex))) continue;
    id = std::uint32_t(mesh.vertices.size());
    mesh.vertices.push_back(vertex);
  }
}

}  // namespace

Mesh meshOf(const Surface& s, const Loop& loop) {
  Mesh mesh;
  mesh.vertices.resize(s.positions.size());
  pieces(loop, mesh.vertices.size(), kGrain, [&](std::size_t a, std::size_t b) {
    for (std::size_t v = a; v < b; ++v) mesh.vertices[v] = vertexOf(s, v);
  });
  const bool allTriangles = std::ranges::all_of(s.faceSizes, [](std::uint8_t size) { return size == 3; });
  if (!allTriangles) splitQuads(s, mesh);
  const Weld welding = weld(mesh.vertices, loop);
  mesh.welded = welding.welded;
  if (allTriangles && welding.id.empty() && !welding.nan) {
    mesh.ids = s.indices;
    return mesh;
  }
  mesh.ownIds.resize(allTriangles ? s.indices.size() : mesh.slots.size());
  pieces(loop, mesh.ownIds.size(), kGrain, [&](std::size_t a, std::size_t b) {
    for (std::size_t i = a; i < b; ++i) {
      const std::uint32_t vertex = s.indices[allTriangles ? i : mesh.slots[i]];
      mesh.ownIds[i] = welding.id.empty() ? vertex : welding.id[vertex];
    }
  });
  if (welding.nan) partNans(mesh);
  mesh.ids = mesh.ownIds;
  return mesh;
}

}  // namespace lmc::tangent
