#include "libtangent/mesh.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>

namespace lmc::tangent {

namespace {

constexpr std::size_t kGrain = 16384;  // vertices or corners a piece
constexpr std::uint32_t kEmpty = ~0u;  // no vertex: problemWith() keeps their number below it
constexpr std::size_t kAhead = 64;     // vertices hashed before the first of them is looked up, so that the table is in the cache

/// The numbers by which vertices weld, -0 turned into +0.
struct Key {
  std::uint32_t part[8];
};
Key keyOf(const Surface& s, std::size_t v) {
  const glm::vec3 p = s.positions[v] + 0.0f, n = s.normals[v] + 0.0f;  // -0 + 0 is +0
  const glm::vec2 t = s.uvs[v] + 0.0f;
  return {{std::bit_cast<std::uint32_t>(p.x), std::bit_cast<std::uint32_t>(p.y), std::bit_cast<std::uint32_t>(p.z),
           std::bit_cast<std::uint32_t>(n.x), std::bit_cast<std::uint32_t>(n.y), std::bit_cast<std::uint32_t>(n.z),
           std::bit_cast<std::uint32_t>(t.x), std::bit_cast<std::uint32_t>(t.y)}};
}
std::uint32_t hashOf(const Key& k) {
  const auto two = [&](int i) { return std::uint64_t(k.part[i]) << 32 | k.part[i + 1]; };
  std::uint64_t a = two(0) * 0x9e3779b97f4a7c15u, b = two(2) * 0xc2b2ae3d27d4eb4fu;
  const std::uint64_t c = two(4) * 0x165667b19e3779f9u, d = two(6) * 0x27d4eb2f165667c5u;
  a ^= a >> 32, b ^= b >> 29;
  std::uint64_t h = (a + (c ^ c >> 31)) * 0xff51afd7ed558ccdu ^ (b + (d ^ d >> 33)) * 0xc4ceb9fe1a85ec53u;
  h ^= h >> 32;
  return std::uint32_t((h * 0x9e3779b97f4a7c15u) >> 32);
}
bool equal(const Surface& s, std::size_t a, std::size_t b) {
  return s.positions[a] == s.positions[b] && s.normals[a] == s.normals[b] && s.uvs[a] == s.uvs[b];
}
bool hasNan(const Surface& s, std::size_t v) {
  const glm::vec3 p = s.positions[v], n = s.normals[v];
  const glm::vec2 t = s.uvs[v];
  return std::isnan(p.x) || std::isnan(p.y) || std::isnan(p.z) || std::isnan(n.x) || std::isnan(n.y) || std::isnan(n.z) ||
         std::isnan(t.x) || std::isnan(t.y);
}

/// An open-addressed set of vertices. Equal ones end up in one slot, which holds the smallest of them in the end whatever the order in
/// which they came: threads may put in side by side.
class VertexSet {
 public:
  VertexSet(const Surface& s, const Loop& loop) : surface_(s), bits_(std::max(4, int(std::bit_width(2 * s.positions.size())))) {
    table_.resize(std::size_t(1) << bits_);
    pieces(loop, table_.size(), kGrain * 4, [&](std::size_t a, std::size_t b) { std::fill(&table_[a], &table_[a] + (b - a), kEmpty); });
  }

  /// Puts vertices [first, last) in, and notes the slot of each. Gives back how many found an equal one there.
  template <bool kShared>
  std::size_t put(std::size_t first, std::size_t last, std::uint32_t* slotOf) {
    std::size_t found = 0;
    std::uint32_t hash[kAhead];
    for (std::size_t at = first; at < last; at += kAhead) {
      const std::size_t n = std::min(kAhead, last - at);
      for (std::size_t i = 0; i < n; ++i) {
        hash[i] = hashOf(keyOf(surface_, at + i)) >> (32 - bits_);
        __builtin_prefetch(&table_[hash[i]], 1);
      }
      for (std::size_t i = 0; i < n; ++i) slotOf[at + i] = putOne<kShared>(std::uint32_t(at + i), hash[i], found);
    }
    return found;
  }
  std::uint32_t at(std::uint32_t slot) const { return table_[slot]; }

 private:
  template <bool kShared>
  std::uint32_t putOne(std::uint32_t vertex, std::uint32_t slot, std::size_t& found) {
    const std::uint32_t mask = std::uint32_t(table_.size() - 1);
    for (;; slot = (slot + 1) & mask) {
      if constexpr (kShared) {
        std::atomic_ref<std::uint32_t> place(table_[slot]);
        std::uint32_t there = place.load(std::memory_order_relaxed);
        if (there == kEmpty && place.compare_exchange_strong(there, vertex, std::memory_order_relaxed)) return slot;
        if (!equal(surface_, there, vertex)) continue;
        while (vertex < there && !place.compare_exchange_weak(there, vertex, std::memory_order_relaxed)) {
        }
      } else {
        const std::uint32_t there = table_[slot];
        if (there == kEmpty) {
          table_[slot] = vertex;
          return slot;
        }
        if (!equal(surface_, there, vertex)) continue;
      }
      ++found;
      return slot;
    }
  }

  const Surface& surface_;
  int bits_;
  Array<std::uint32_t> table_;
};

/// The id of each vertex: the smallest vertex equal to it. Empty when all differ.
Array<std::uint32_t> weld(const Surface& s, const Loop& loop, std::size_t& welded) {
  const std::size_t n = s.positions.size();
  VertexSet set(s, loop);
  Array<std::uint32_t> id;
  id.resize(n);
  std::atomic<std::size_t> found{0};
  const bool shared = loop.each && loop.threads > 1;
  pieces(loop, n, kGrain,
         [&](std::size_t a, std::size_t b) { found += shared ? set.put<true>(a, b, id.data()) : set.put<false>(a, b, id.data()); });
  welded = found;
  if (welded == 0) return {};
  pieces(loop, n, kGrain, [&](std::size_t a, std::size_t b) {
    for (std::size_t v = a; v < b; ++v) id[v] = set.at(id[v]);
  });
  return id;
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
void partNans(Mesh& mesh, const std::vector<std::uint8_t>& isNan) {
  mesh.ownPositions.assign(mesh.positions.begin(), mesh.positions.end());
  mesh.ownNormals.assign(mesh.normals.begin(), mesh.normals.end());
  mesh.ownUvs.assign(mesh.uvs.begin(), mesh.uvs.end());
  for (std::uint32_t& id : mesh.ownIds) {
    if (!isNan[id]) continue;
    const std::uint32_t from = id;
    id = std::uint32_t(mesh.ownPositions.size());
    mesh.ownPositions.push_back(mesh.positions[from]);
    mesh.ownNormals.push_back(mesh.normals[from]);
    mesh.ownUvs.push_back(mesh.uvs[from]);
  }
  mesh.positions = mesh.ownPositions, mesh.normals = mesh.ownNormals, mesh.uvs = mesh.ownUvs;
}

std::vector<std::uint8_t> nanVertices(const Surface& s, const Loop& loop) {
  std::vector<std::uint8_t> out;
  std::atomic<bool> any{false};
  pieces(loop, s.positions.size(), kGrain, [&](std::size_t a, std::size_t b) {
    // A sum is NaN when a part is; opposite infinities only cost the closer look below.
    float sum = 0.0f;
    for (std::size_t v = a; v < b; ++v)
      sum += 0.0f * (s.positions[v].x + s.positions[v].y + s.positions[v].z + s.normals[v].x + s.normals[v].y + s.normals[v].z +
                     s.uvs[v].x + s.uvs[v].y);
    if (sum != 0.0f) any = true;
  });
  if (!any) return out;
  out.resize(s.positions.size());
  bool found = false;
  for (std::size_t v = 0; v < out.size(); ++v) found |= (out[v] = hasNan(s, v)) != 0;
  if (!found) out.clear();
  return out;
}

}  // namespace

Mesh meshOf(const Surface& s, const Loop& loop) {
  Mesh mesh;
  mesh.positions = s.positions, mesh.normals = s.normals, mesh.uvs = s.uvs;
  const bool allTriangles = std::ranges::all_of(s.faceSizes, [](std::uint8_t size) { return size == 3; });
  if (!allTriangles) splitQuads(s, mesh);
  const Array<std::uint32_t> id = weld(s, loop, mesh.welded);
  const std::vector<std::uint8_t> isNan = nanVertices(s, loop);
  if (allTriangles && id.empty() && isNan.empty()) {
    mesh.ids = s.indices;
    return mesh;
  }
  mesh.ownIds.resize(allTriangles ? s.indices.size() : mesh.slots.size());
  pieces(loop, mesh.ownIds.size(), kGrain, [&](std::size_t a, std::size_t b) {
    for (std::size_t i = a; i < b; ++i) {
      const std::uint32_t vertex = s.indices[allTriangles ? i : mesh.slots[i]];
      mesh.ownIds[i] = id.empty() ? vertex : id[vertex];
    }
  });
  if (!isNan.empty()) partNans(mesh, isNan);
  mesh.ids = mesh.ownIds;
  return mesh;
}

}  // namespace lmc::tangent
