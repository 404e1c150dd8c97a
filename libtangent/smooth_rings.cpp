#include "libtangent/smooth_rings.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#ifdef __SSE2__
#include <emmintrin.h>
#endif

#include "libtangent/four.h"

namespace lmc::tangent {

namespace {

constexpr std::uint32_t kMaxRing = 32;  // triangles; a set of places is a word
constexpr std::size_t kBatch = 16;      // rings in work together: what is written in one step is read in the next, not at once
constexpr std::uint8_t kNone = 255;

// Two members at an angle of 80 degrees or more make the sum of the weighted S shorter than the sum of the weights by
// w + w' - |w s + w' s'| >= 2 (1 - cos 40 deg) min(w, w'). A sum that lacks less has none.
constexpr float kLack = 0.46f;
constexpr float kAgreeS = 0.05f;      // cosine: within 87 degrees of one member, so less than 175 of any other
constexpr float kAgreeT = 0.2f;       // 78 degrees: the short T are off by up to 5
constexpr float kLeastSquare = 0.1f;  // of T in the plane: shorter, and its steps turn it farther than that

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

/// A ring in work.
struct Ring {
  std::uint32_t id, size;
  const RingCorner* corner;
  std::uint32_t flags, common, atCorners;        ///< of all triangles: or, and; or of those shifted by the corner
  Four sum, least;                               ///< of Frame::weighted
  alignas(16) std::uint32_t next[kMaxRing + 8];  ///< then no id, up to the next multiple of 8
  std::uint32_t previous[kMaxRing];
  std::uint8_t coming[kMaxRing], leaving[kMaxRing];  ///< neighbours, as Across

  std::uint32_t everyone() const { return size == 32 ? ~0u : (1u << size) - 1; }
  std::uint32_t slot(std::uint32_t i) const { return corner[i] - triangleOf(corner[i]); }  // 4 t + c - t
};

void gather(const Frames& frames, Ring& ring) {
  ring.flags = ring.atCorners = 0;
  ring.common = ~0u;
  Four sum{}, least = all(4.0f);  // no angle is larger
  for (std::uint32_t i = 0; i < ring.size; ++i) {
    const std::uint32_t c = cornerOf(ring.corner[i]);
    const Frame& frame = frames.of[triangleOf(ring.corner[i])];
    const Four weighted = loadFour(frame.weighted[c]);
    sum += weighted;
    least = smaller(weighted, least);
    ring.next[i] = frame.ids[kNextCorner[c]];
    ring.previous[i] = frame.ids[kPreviousCorner[c]];
    ring.flags |= frame.flags;
    ring.common &= frame.flags;
    ring.atCorners |= frame.flags >> c;
  }
  std::memset(ring.next + ring.size, 0xff, 32);
  ring.sum = sum;
  ring.least = least;
}

/// Fills coming. False where a side has more than two triangles, or two that run the same way. `heads`: those that nobody comes to.
bool link(Ring& ring, std::uint32_t& heads) {
  std::uint32_t used = 0, twice = 0;
  for (std::uint32_t i = 0; i < ring.size; ++i) {
    const std::uint32_t found = placesOf(ring.previous[i], ring.next, ring.size);
    twice |= (found & (found - 1)) | (found & used);
    used |= found;
    ring.coming[i] = found ? std::uint8_t(std::countr_zero(found)) : kNone;
  }
  heads = ring.everyone() & ~used;
  return twice == 0;
}

/// Whether all places follow one another.
bool hangsTogether(const Ring& ring, std::uint32_t heads) {
  const std::uint8_t start = heads ? std::uint8_t(std::countr_zero(heads)) : 0;
  std::uint32_t count = 1;
  for (std::uint8_t at = ring.coming[start]; at != kNone && at != start; at = ring.coming[at]) ++count;
  return count == ring.size;
}

/// The places reached from one of them, without leaving those allowed.
std::uint32_t reached(const Ring& ring, std::uint32_t start, std::uint32_t allowed) {
  std::uint32_t members = 1u << start;
  for (std::uint8_t at = ring.coming[start]; at != kNone && (allowed & ~members) >> at & 1; at = ring.coming[at]) members |= 1u << at;
  for (std::uint8_t at = ring.leaving[start]; at != kNone && (allowed & ~members) >> at & 1; at = ring.leaving[at]) members |= 1u << at;
  return members;
}

void fillLeaving(Ring& ring) {
  std::memset(ring.leaving, kNone, sizeof ring.leaving);
  for (std::uint32_t i = 0; i < ring.size; ++i)
    if (ring.coming[i] != kNone) ring.leaving[ring.coming[i]] = std::uint8_t(i);
}

glm::vec3 shortT(std::uint32_t flags) {
  const auto axis = [&](int i) {
    const int left = 32 - kShortShift - kShortBits * (i + 1);
    return float(std::int32_t(flags << left) >> (32 - kShortBits)) / kShortSteps;
  };
  return {axis(0), axis(1), axis(2)};
}

class Worker {
 public:
  Worker(const Mesh& mesh, const Frames& frames, const Rings& rings, const Output& output, Remarks& remarks)
      : mesh_(mesh), frames_(frames), output_(output), remarks_(remarks), fan_(mesh, frames, rings, output) {}

  /// Up to kBatch rings, step by step.
  void work() {
    for (std::size_t r = 0; r < count_; ++r) {
      fetchAhead(batch_[r]);
      gather(frames_, batch_[r]);
    }
    for (std::size_t r = 0; r < count_; ++r) finish(batch_[r]);
    count_ = 0;
  }

  void take(std::uint32_t id, std::span<const RingCorner> corners) {
    if (corners.empty()) return;
    if (corners.size() > kMaxRing || mesh_.hasQuads()) return fan_.compute(id, remarks_);
    batch_[count_].id = id;
    batch_[count_].corner = corners.data();
    batch_[count_].size = std::uint32_t(corners.size());
    if (++count_ == kBatch) work();
  }

 private:
  /// Asks the memory for what rings further on will read and write: triangles round a vertex may be far apart.
  void fetchAhead(const Ring& ring) {
    for (std::uint32_t i = 0; i < ring.size; ++i) {
      const RingCorner c = ring.corner[i + Rings::kAhead];
      __builtin_prefetch(&frames_.of[triangleOf(c)]);
      output_.prefetch(c - triangleOf(c));
    }
  }

  void finish(Ring& ring) {
    std::uint32_t heads;
    if (!link(ring, heads)) return fan_.compute(ring.id, remarks_);
    const bool alike = !(ring.flags & kFrameless) && !((ring.flags ^ ring.common) & kPreserving);
    if (!alike || !hangsTogether(ring, heads)) return finishParts(ring);
    const glm::vec3 sum(ring.sum[0], ring.sum[1], ring.sum[2]);
    // No two S are 80 degrees apart, and each T lies 45 to 135 degrees to the same side of its S: no two T are opposite either.
    const bool plain = !(ring.atCorners & (kUnsteady | kSkewed)) && ring.sum[3] - std::sqrt(glm::dot(sum, sum)) < kLack * ring.least[3];
    if (!plain && !agrees(ring, ring.everyone())) return fan_.compute(ring.id, remarks_);
    ++remarks_.groups;
    writeGroup(ring, ring.everyone(), unit(sum));
  }

  /// Several groups, or frameless triangles.
  void finishParts(Ring& ring) {
    fillLeaving(ring);
    std::uint32_t ways = 0, framed = 0;
    for (std::uint32_t i = 0; i < ring.size; ++i) {
      const std::uint32_t flags = frames_.of[triangleOf(ring.corner[i])].flags;
      ways |= (flags & kPreserving) << i;
      framed |= (flags & kFrameless ? 0u : 1u) << i;
    }
    std::uint32_t group[kMaxRing], groups = 0, grouped = 0;
    for (std::uint32_t open = framed; open != 0; open &= ~grouped) {
      const std::uint32_t start = std::uint32_t(std::countr_zero(open));
      const std::uint32_t members = reached(ring, start, ways >> start & 1 ? ways : ring.everyone() & ~ways);
      if (!agrees(ring, members & framed)) return fan_.compute(ring.id, remarks_);
      group[groups++] = members;
      grouped |= members;
    }
    for (std::uint32_t g = 0; g < groups; ++g) {
      Four sum{};
      for (std::uint32_t rest = group[g]; rest != 0; rest &= rest - 1) sum += weightedAt(ring, std::uint32_t(std::countr_zero(rest)));
      writeGroup(ring, group[g], unit(glm::vec3(sum[0], sum[1], sum[2])));  // frameless ones added zero
    }
    remarks_.groups += groups;
    fillRest(ring, ring.everyone() & ~grouped);
  }

  Four weightedAt(const Ring& ring, std::uint32_t i) const {
    return loadFour(frames_.of[triangleOf(ring.corner[i])].weighted[cornerOf(ring.corner[i])]);
  }

  /// Whether no two members can be opposite: all within some angle of the first, S and T.
  bool agrees(const Ring& ring, std::uint32_t members) const {
    const glm::vec3 n = mesh_.vertices[ring.id].normal;
    glm::vec3 firstS(0.0f), firstT(0.0f);
    float leastS = 0.0f, leastT = 0.0f;
    for (std::uint32_t rest = members; rest != 0; rest &= rest - 1) {
      const std::uint32_t i = std::uint32_t(std::countr_zero(rest));
      const std::uint32_t flags = frames_.of[triangleOf(ring.corner[i])].flags;
      const Four weighted = weightedAt(ring, i);
      const glm::vec3 s(weighted[0], weighted[1], weighted[2]), t = inPlane(n, shortT(flags));
      const float squareS = glm::dot(s, s), squareT = glm::dot(t, t);
      if (rest == members) {
        firstS = s, firstT = t;
        leastS = kAgreeS * kAgreeS * squareS, leastT = kAgreeT * kAgreeT * squareT;
      }
      const float dotS = glm::dot(firstS, s), dotT = glm::dot(firstT, t);
      const bool good = !(flags >> cornerOf(ring.corner[i]) & kUnsteady) & (dotS > 0.0f) & (dotS * dotS > leastS * squareS) &
                        (dotT > 0.0f) & (dotT * dotT > leastT * squareT) & (squareT > kLeastSquare);
      if (!good) return false;
    }
    return true;
  }

  void writeGroup(const Ring& ring, std::uint32_t members, glm::vec3 tangent) {
    const std::uint32_t flags = frames_.of[triangleOf(ring.corner[std::countr_zero(members)])].flags;
    const float determinant = output_.determinantOf(flags);
    for (std::uint32_t i = 0; i < ring.size; ++i)
      if (members >> i & 1) output_.write(ring.slot(i), tangent, determinant);
    Mend why;
    if (output_.exact() || serves(tangent, mesh_.vertices[ring.id].normal, why)) return;
    for (; members != 0; members &= members - 1) remark(ring, std::uint32_t(std::countr_zero(members)), why);
  }

  /// Frameless triangles that no group reaches.
  void fillRest(const Ring& ring, std::uint32_t rest) {
    for (; rest != 0; rest &= rest - 1) {
      const std::uint32_t i = std::uint32_t(std::countr_zero(rest));
      output_.writeFiller(ring.slot(i));
      if (!output_.exact()) remark(ring, i, Mend::NoFrame);
    }
  }

  void remark(const Ring& ring, std::uint32_t i, Mend why) {
    remarks_.bad.push_back({ring.slot(i), ring.id, triangleOf(ring.corner[i]), why});
  }

  const Mesh& mesh_;
  const Frames& frames_;
  const Output& output_;
  Remarks& remarks_;
  Fan fan_;
  Ring batch_[kBatch];
  std::size_t count_ = 0;
};

}  // namespace

void computeRings(const Mesh& mesh, const Frames& frames, const Rings& rings, const Output& output, std::uint32_t first, std::uint32_t last,
                  Remarks& remarks) {
  Worker worker(mesh, frames, rings, output, remarks);
  for (std::uint32_t id = first; id < last; ++id) worker.take(id, rings.of(id));
  worker.work();
}

}  // namespace lmc::tangent
