#include "libtangent/smooth_rings.h"

#include <bit>
#ifdef __SSE2__
#include <emmintrin.h>
#endif

#include "libtangent/angle.h"
#include "libtangent/simd.h"

namespace lmc::tangent {

namespace {

constexpr std::uint32_t kMaxRing = 32;  // triangles; a set of places is a word
constexpr std::uint32_t kPlaces = 256;  // corners in work together: what a block holds stays in the first cache
constexpr float kAgree = 0.05f;         // cosine, as in fan.cpp
constexpr float kLeastSquare = 1e-12f;  // of what is left of a unit vector in the plane: below, rounding has the word

/// Vectors as structure of arrays.
template <std::size_t kCount>
struct Vectors {
  alignas(64) float x[kCount], y[kCount], z[kCount];
  void set(std::size_t i, glm::vec3 v) { x[i] = v.x, y[i] = v.y, z[i] = v.z; }
  glm::vec3 at(std::size_t i) const { return {x[i], y[i], z[i]}; }
};

struct Group {
  std::uint32_t members;  ///< bit per place of the ring
  std::uint32_t flags;    ///< kPreserving
};
struct Ring {
  std::uint32_t id;
  std::uint32_t base, size;  ///< places
  std::uint32_t firstGroup, groups;
  std::uint32_t framed;  ///< bit per place: it has a frame
};

/// Corners of some rings, one after the other: a place each, which also stands for the side that leaves the vertex there. Sides along which
/// only a triangle comes (the rim of a surface) have places of their own from kPlaces on.
struct Block {
  Vectors<2 * kPlaces> normal, side;
  Vectors<kPlaces> s, t;
  alignas(64) float cosine[kPlaces], angle[kPlaces], tSquare[kPlaces];
  alignas(64) unsigned doubt[kPlaces], steady[kPlaces];
  std::uint32_t coming[kPlaces];  ///< place of the side that comes to the vertex
  RingCorner corner[kPlaces];
  Group group[kPlaces];
  Ring ring[kPlaces];
  std::uint32_t places = 0, rims = 0, groups = 0, rings = 0;

  bool hasRoom() const { return places + kMaxRing <= kPlaces; }
};

/// v becomes the unit vector of its part in the plane of n, as unitInPlane(). Rounded up to whole vectors: what lies behind is waste.
template <std::size_t kA, std::size_t kB>
LMC_INLINE void projectAll(const Vectors<kA>& n, Vectors<kB>& v, std::uint32_t first, std::uint32_t last) {
  for (std::uint32_t i = first; i < last; ++i) {
    const float d = n.x[i] * v.x[i] + n.y[i] * v.y[i] + n.z[i] * v.z[i];
    const float x = v.x[i] - d * n.x[i], y = v.y[i] - d * n.y[i], z = v.z[i] - d * n.z[i];
    const bool nonzero = (std::abs(x) > FLT_MIN) | (std::abs(y) > FLT_MIN) | (std::abs(z) > FLT_MIN);
    const float length = std::sqrt(x * x + y * y + z * z);
    const float scale = 1.0f / (nonzero ? length : 1.0f);
    v.x[i] = scale * x, v.y[i] = scale * y, v.z[i] = scale * z;
  }
}

/// All that is the same for each corner.
LMC_INLINE void workAll(Block& b) {
  projectAll(b.normal, b.side, 0, b.places);
  projectAll(b.normal, b.side, kPlaces, kPlaces + b.rims);
  for (std::uint32_t i = 0; i < b.places; ++i) {
    // T is asked for its side alone: it stays as long as it comes out.
    const float dt = b.normal.x[i] * b.t.x[i] + b.normal.y[i] * b.t.y[i] + b.normal.z[i] * b.t.z[i];
    const float tx = b.t.x[i] - dt * b.normal.x[i], ty = b.t.y[i] - dt * b.normal.y[i], tz = b.t.z[i] - dt * b.normal.z[i];
    b.t.x[i] = tx, b.t.y[i] = ty, b.t.z[i] = tz;
    b.tSquare[i] = tx * tx + ty * ty + tz * tz;
    const float ds = b.normal.x[i] * b.s.x[i] + b.normal.y[i] * b.s.y[i] + b.normal.z[i] * b.s.z[i];
    const float x = b.s.x[i] - ds * b.normal.x[i], y = b.s.y[i] - ds * b.normal.y[i], z = b.s.z[i] - ds * b.normal.z[i];
    const float square = x * x + y * y + z * z;
    b.steady[i] = (square > kLeastSquare) & (b.tSquare[i] > kLeastSquare);
    const float scale = 1.0f / std::sqrt(square);
    b.s.x[i] = scale * x, b.s.y[i] = scale * y, b.s.z[i] = scale * z;
  }
  for (std::uint32_t i = 0; i < b.places; ++i) {
    const std::uint32_t c = b.coming[i];
    const float cosine = b.side.x[c] * b.side.x[i] + b.side.y[c] * b.side.y[i] + b.side.z[c] * b.side.z[i];
    b.cosine[i] = cosine > 1.0f ? 1.0f : cosine < -1.0f ? -1.0f : cosine;
  }
  angles(b.cosine, b.angle, b.doubt, int(b.places));
}
void workPlain(Block& b) { workAll(b); }
LMC_AVX2 void workAvx2(Block& b) { workAll(b); }

/// Bit i: all[i] == id. `all` is read up to the next multiple of 8.
std::uint32_t placesOf(std::uint32_t id, const std::uint32_t* all, std::uint32_t count) {
  std::uint32_t found = 0;
#ifdef __SSE2__
  const __m128i wanted = _mm_set1_epi32(int(id));
  for (std::uint32_t i = 0; i < count; i += 8) {
    const __m128i low = _mm_cmpeq_epi32(_mm_load_si128(reinterpret_cast<const __m128i*>(all + i)), wanted);
    const __m128i high = _mm_cmpeq_epi32(_mm_load_si128(reinterpret_cast<const __m128i*>(all + i + 4)), wanted);
    const __m128i words = _mm_packs_epi32(low, high);
    found |= std::uint32_t(_mm_movemask_epi8(_mm_packs_epi16(words, _mm_setzero_si128()))) << i;
  }
#else
  for (std::uint32_t i = 0; i < count; ++i) found |= std::uint32_t(all[i] == id) << i;
#endif
  return found;
}

class Worker {
 public:
  Worker(const Mesh& mesh, const Frames& frames, const Rings& rings, const Output& output, Remarks& remarks)
      : mesh_(mesh), frames_(frames), rings_(rings), output_(output), remarks_(remarks), fan_(mesh, frames, rings, output) {}

  void take(std::uint32_t id) {
    const std::span<const RingCorner> ring = rings_.of(id);
    if (ring.empty()) return;
    if (ring.size() > kMaxRing || mesh_.hasQuads()) return fan_.compute(id, remarks_);
    if (!block_.hasRoom()) finish();
    if (!gather(id, ring)) fan_.compute(id, remarks_);
  }

  void finish() {
    hasAvx2() ? workAvx2(block_) : workPlain(block_);
    for (std::uint32_t i = 0; i < block_.places; ++i)
      if (block_.doubt[i]) block_.angle[i] = float(std::acos(double(block_.cosine[i])));
    for (std::uint32_t r = 0; r < block_.rings; ++r) finishRing(block_.ring[r]);
    block_.places = block_.rims = block_.groups = block_.rings = 0;
  }

 private:
  /// Neighbours round the ring in work, as Across.
  struct Links {
    alignas(16) std::uint32_t next[kMaxRing];
    std::uint32_t previous[kMaxRing];
    std::uint8_t coming[kMaxRing], leaving[kMaxRing];
  };
  static constexpr std::uint8_t kNone = 255;

  bool gather(std::uint32_t id, std::span<const RingCorner> ring) {
    const std::uint32_t base = block_.places, size = std::uint32_t(ring.size());
    const glm::vec3 n = mesh_.normals[id], p = mesh_.positions[id];
    std::uint32_t all = 0, ways = 0;
    Ring record{id, base, size, block_.groups, 0, 0};
    for (std::uint32_t i = 0; i < size; ++i) {
      const RingCorner c = ring[i];
      const std::uint32_t* ids = &mesh_.ids[3 * std::size_t(triangleOf(c))];
      const Frame& frame = frames_.of[triangleOf(c)];
      links_.next[i] = ids[kNextCorner[cornerOf(c)]];
      links_.previous[i] = ids[kPreviousCorner[cornerOf(c)]];
      const std::uint32_t at = base + i;
      block_.corner[at] = c;
      block_.normal.set(at, n);
      block_.side.set(at, mesh_.positions[links_.next[i]] - p);
      block_.s.set(at, frame.s);
      block_.t.set(at, frame.t);
      all |= frame.flags;
      ways |= (frame.flags & kPreserving) << i;
      record.framed |= std::uint32_t((frame.flags & kFrameless) == 0) << i;
    }
    for (std::uint32_t i = size; i < ((size + 7) & ~7u); ++i) links_.next[i] = kNobody;
    const std::uint32_t rims = block_.rims;
    if (!link(base, size, n, p)) {
      block_.rims = rims;
      return false;
    }
    const std::uint32_t everyone = size == 32 ? ~0u : (1u << size) - 1;
    if (record.framed == everyone && (ways == 0 || ways == everyone) && hangsTogether(size))
      block_.group[block_.groups++] = {everyone, all & kPreserving};
    else
      findGroups(size, ways, record.framed);
    record.groups = block_.groups - record.firstGroup;
    block_.places += size;
    block_.ring[block_.rings++] = record;
    return true;
  }

  /// False where a side has more than two triangles, or two that run the same way.
  bool link(std::uint32_t base, std::uint32_t size, glm::vec3 n, glm::vec3 p) {
    std::uint32_t used = 0;
    for (std::uint32_t i = 0; i < size; ++i) links_.leaving[i] = kNone;
    for (std::uint32_t i = 0; i < size; ++i) {
      const std::uint32_t found = placesOf(links_.previous[i], links_.next, size);
      if ((found & (found - 1)) || (found & used)) return false;
      used |= found;
      if (found != 0) {
        const std::uint32_t j = std::uint32_t(std::countr_zero(found));
        links_.coming[i] = std::uint8_t(j);
        links_.leaving[j] = std::uint8_t(i);
        block_.coming[base + i] = base + j;
      } else {
        const std::uint32_t at = kPlaces + block_.rims++;
        links_.coming[i] = kNone;
        block_.coming[base + i] = at;
        block_.normal.set(at, n);
        block_.side.set(at, mesh_.positions[links_.previous[i]] - p);
      }
    }
    return true;
  }

  bool hangsTogether(std::uint32_t size) const {
    std::uint32_t count = 1;
    std::uint8_t at = links_.coming[0];
    for (; at != kNone && at != 0; at = links_.coming[at]) ++count;
    if (at == kNone)
      for (at = links_.leaving[0]; at != kNone; at = links_.leaving[at]) ++count;
    return count == size;
  }

  void findGroups(std::uint32_t size, std::uint32_t ways, std::uint32_t framed) {
    std::uint32_t grouped = 0;
    for (std::uint32_t start = 0; start < size; ++start) {
      if ((grouped >> start & 1) || !(framed >> start & 1)) continue;
      const std::uint32_t same = ways >> start & 1 ? ways : ~ways;
      std::uint32_t members = 0;
      const auto follow = [&](const std::uint8_t* across) {
        for (std::uint8_t at = across[start]; at != kNone && (same >> at & 1) && !(members >> at & 1); at = across[at]) members |= 1u << at;
      };
      members = 1u << start;
      follow(links_.coming);
      follow(links_.leaving);
      grouped |= members;
      block_.group[block_.groups++] = {members, ways >> start & 1 ? kPreserving : 0u};
    }
  }

  /// Whether no two members can be opposite: all within 87 degrees of the first, S and T.
  bool agrees(const Ring& ring, const Group& group) const {
    const Block& b = block_;
    std::uint32_t rest = group.members & ring.framed;
    const std::uint32_t f = ring.base + std::uint32_t(std::countr_zero(rest));
    const glm::vec3 s = b.s.at(f), t = b.t.at(f);
    const float least = kAgree * kAgree * b.tSquare[f];
    unsigned good = 1;
    for (; rest != 0; rest &= rest - 1) {
      const std::uint32_t i = ring.base + std::uint32_t(std::countr_zero(rest));
      const float x = glm::dot(t, b.t.at(i));
      good &= b.steady[i] & unsigned(glm::dot(s, b.s.at(i)) > kAgree) & unsigned(x > 0.0f) & unsigned(x * x > least * b.tSquare[i]);
    }
    return good != 0;
  }

  void finishRing(const Ring& ring) {
    const Group* groups = block_.group + ring.firstGroup;
    for (std::uint32_t g = 0; g < ring.groups; ++g)
      if (!agrees(ring, groups[g])) return fan_.compute(ring.id, remarks_);
    std::uint32_t grouped = 0;
    for (std::uint32_t g = 0; g < ring.groups; ++g) {
      finishGroup(ring, groups[g]);
      grouped |= groups[g].members;
    }
    remarks_.groups += ring.groups;
    for (std::uint32_t i = 0; i < ring.size; ++i) {
      if (grouped >> i & 1) continue;
      output_.writeFiller(slotAt(ring, i));
      if (!output_.exact()) remark(ring, i, Mend::NoFrame);
    }
  }

  void finishGroup(const Ring& ring, const Group& group) {
    const Block& b = block_;
    glm::vec3 sum(0.0f);
    for (std::uint32_t rest = group.members & ring.framed; rest != 0; rest &= rest - 1) {
      const std::uint32_t i = ring.base + std::uint32_t(std::countr_zero(rest));
      sum += b.angle[i] * b.s.at(i);
    }
    const glm::vec3 tangent = unit(sum);
    const float determinant = output_.determinantOf(group.flags);
    for (std::uint32_t rest = group.members; rest != 0; rest &= rest - 1)
      output_.write(slotAt(ring, std::uint32_t(std::countr_zero(rest))), tangent, determinant);
    Mend why;
    if (output_.exact() || serves(tangent, b.normal.at(ring.base), why)) return;
    for (std::uint32_t rest = group.members; rest != 0; rest &= rest - 1) remark(ring, std::uint32_t(std::countr_zero(rest)), why);
  }

  std::uint32_t slotAt(const Ring& ring, std::uint32_t i) const {
    const RingCorner c = block_.corner[ring.base + i];
    return 3 * triangleOf(c) + cornerOf(c);
  }
  void remark(const Ring& ring, std::uint32_t i, Mend why) {
    remarks_.bad.push_back({slotAt(ring, i), ring.id, triangleOf(block_.corner[ring.base + i]), why});
  }

  const Mesh& mesh_;
  const Frames& frames_;
  const Rings& rings_;
  const Output& output_;
  Remarks& remarks_;
  Fan fan_;
  Links links_{};
  Block block_{};
};

}  // namespace

void computeRings(const Mesh& mesh, const Frames& frames, const Rings& rings, const Output& output, std::uint32_t first, std::uint32_t last,
                  Remarks& remarks) {
  Worker worker(mesh, frames, rings, output, remarks);
  for (std::uint32_t id = first; id < last; ++id) worker.take(id);
  worker.finish();
}

}  // namespace lmc::tangent
