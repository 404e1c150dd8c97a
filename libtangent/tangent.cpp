#include "libtangent/tangent.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <numeric>
#include <stdexcept>
#include <thread>

#include "libtangent/mend.h"
#include "libtangent/smooth_rings.h"

namespace lmc::tangent {

namespace {

constexpr std::size_t kCornersAPiece = 8192;
constexpr std::size_t kMaxTriangles = std::size_t(1) << 29;  // a corner of a ring is one word, and so is a corner of the surface

/// First id whose ring begins at or after a corner.
std::uint32_t idAt(const Rings& rings, std::size_t corner) {
  return std::uint32_t(std::ranges::lower_bound(rings.start.begin(), rings.start.end() - 1, corner) - rings.start.begin());
}

/// All rings, in pieces of about as many corners. Remarks come in the order of vertices.
Remarks computeAllRings(const Mesh& mesh, const Frames& frames, const Rings& rings, const Output& output, const Loop& loop) {
  const std::size_t count = (rings.start.back() + kCornersAPiece - 1) / kCornersAPiece;
  std::vector<Remarks> remarks(count);
  pieces(loop, count, 1, [&](std::size_t i, std::size_t) {
    computeRings(mesh, frames, rings, output, idAt(rings, i * kCornersAPiece), idAt(rings, (i + 1) * kCornersAPiece), remarks[i]);
  });
  Remarks all;
  for (Remarks& r : remarks) {
    all.bad.insert(all.bad.end(), r.bad.begin(), r.bad.end());
    all.groups += r.groups;
    all.hugeGroups += r.hugeGroups;
  }
  return all;
}

void copyFrom(const Mesh& mesh, const Output& output, std::uint32_t slot, std::uint32_t id, std::uint32_t triangle, std::uint32_t source,
              Remarks& remarks) {
  output.copy(slot, source);
  if (output.exact()) return;
  Mend why = Mend::NoFrame;
  if (output.determinant(slot) == 0.0f || !serves(output.tangent(slot), mesh.vertices[id].normal, why))
    remarks.bad.push_back({slot, id, triangle, why});
}

/// A corner of a degenerate triangle takes over from the first good corner of its vertex.
void copyToDegenerate(const Mesh& mesh, const Rings& rings, const Output& output, std::uint32_t triangle, Remarks& remarks) {
  for (std::uint32_t c = 0; c < 3; ++c) {
    const std::uint32_t id = mesh.ids[3 * std::size_t(triangle) + c], slot = mesh.slotOf(triangle, c);
    const std::span<const RingCorner> ring = rings.of(id);
    if (!ring.empty()) {
      copyFrom(mesh, output, slot, id, triangle, mesh.slotOf(triangleOf(ring[0]), cornerOf(ring[0])), remarks);
      continue;
    }
    output.writeFiller(slot);
    if (!output.exact()) remarks.bad.push_back({slot, id, triangle, Mend::NoFrame});
  }
}

/// The corner of a quad that its good half lacks takes over from the good half's first corner at the same position.
void copyWithinQuad(const Mesh& mesh, const Output& output, std::uint32_t degenerate, std::uint32_t good, Remarks& remarks) {
  for (std::uint32_t c = 0; c < 3; ++c) {
    const std::uint32_t slot = mesh.slotOf(degenerate, c), id = mesh.ids[3 * std::size_t(degenerate) + c];
    bool held = false;
    for (std::uint32_t k = 0; k < 3; ++k) held |= mesh.slotOf(good, k) == slot;
    if (held) continue;
    for (std::uint32_t k = 0; k < 3; ++k) {
      if (mesh.vertices[mesh.ids[3 * std::size_t(good) + k]].position != mesh.vertices[id].position) continue;
      copyFrom(mesh, output, slot, id, degenerate, mesh.slotOf(good, k), remarks);
      return;
    }
    output.writeFiller(slot);
    if (!output.exact()) remarks.bad.push_back({slot, id, degenerate, Mend::NoFrame});
  }
}

void finishDegenerate(const Mesh& mesh, const Frames& frames, const Rings& rings, const Output& output, Remarks& remarks) {
  // First the whole ones: a quad's half may take over from a corner, never the other way round.
  for (const std::uint32_t t : frames.degenerate)
    if (!(frames.of[t].flags & kLoneHalf)) copyToDegenerate(mesh, rings, output, t, remarks);
  for (const std::uint32_t t : frames.degenerate) {
    if (!(frames.of[t].flags & kLoneHalf)) continue;
    const bool first = t + 1 < mesh.triangleCount() && mesh.faceOf(t + 1) == mesh.faceOf(t);
    copyWithinQuad(mesh, output, t, first ? t + 1 : t - 1, remarks);
  }
}

/// Faces that are neither triangles nor quads have no triangles here: their corners keep the filler.
void fillOtherFaces(const Surface& s, const Mesh& mesh, const Output& output, Remarks& remarks) {
  if (!mesh.hasQuads() && s.faceSizes.size() * 3 == s.indices.size()) return;
  std::uint32_t start = 0;
  for (const std::uint8_t size : s.faceSizes) {
    for (std::uint32_t c = start; c < start + size && size != 3 && size != 4; ++c) {
      output.writeFiller(c);
      if (!output.exact()) remarks.bad.push_back({c, s.indices[c], kNoTriangle, Mend::NoFrame});
    }
    start += size;
  }
}

/// Writes every corner of the output.
Counts computeInto(const Surface& s, const Loop& loop, const Output& output, std::vector<MendedCorner>* mended) {
  if (const std::string problem = problemWith(s); !problem.empty()) throw std::invalid_argument(problem);
  const Mesh mesh = meshOf(s, loop);
  Frames frames = framesOf(mesh, loop);
  const Rings rings = ringsOf(mesh, frames, loop);
  orientFrameless(mesh, rings, frames);
  Remarks remarks = computeAllRings(mesh, frames, rings, output, loop);
  finishDegenerate(mesh, frames, rings, output, remarks);
  fillOtherFaces(s, mesh, output, remarks);
  if (mended) *mended = mendAll(s, mesh, frames, output, std::move(remarks.bad), loop);
  return {mesh.triangleCount(), frames.degenerate.size(), frames.frameless.size(), mesh.welded, remarks.groups, remarks.hugeGroups};
}

}  // namespace

std::string problemWith(const Surface& s) {
  const std::size_t vertices = s.positions.size(), corners = s.indices.size();
  if (s.normals.size() != vertices) return std::to_string(s.normals.size()) + " normals for " + std::to_string(vertices) + " positions";
  if (s.uvs.size() != vertices) return std::to_string(s.uvs.size()) + " texture coordinates for " + std::to_string(vertices) + " positions";
  if (corners / 3 > kMaxTriangles || vertices >= 0xffffffffu - corners) return "more than 2^29 triangles";
  if (s.faceSizes.empty()) {
    if (corners % 3 != 0) return std::to_string(corners) + " indices, which is no multiple of 3";
  } else {
    const std::size_t sum = std::accumulate(s.faceSizes.begin(), s.faceSizes.end(), std::size_t(0));
    if (sum != corners) return "faces of " + std::to_string(sum) + " corners in all, but " + std::to_string(corners) + " indices";
  }
  std::uint32_t largest = 0;
  for (const std::uint32_t v : s.indices) largest = std::max(largest, v);
  if (corners == 0 || largest < vertices) return {};
  const std::size_t at = std::size_t(std::ranges::find_if(s.indices, [&](std::uint32_t v) { return v >= vertices; }) - s.indices.begin());
  return "corner " + std::to_string(at) + " is vertex " + std::to_string(s.indices[at]) + " of " + std::to_string(vertices);
}

const char* textOf(Mend why) {
  constexpr const char* kText[kMendCount] = {"not finite", "zero", "no triangle with an area in UV", "not orthogonal to the normal",
                                             "not of unit length"};
  return kText[int(why)];
}

Loop threadedLoop(int threads) {
  return {threads, [count = std::size_t(std::max(1, threads))](std::size_t n, const std::function<void(std::size_t)>& body) {
            // Claims go round as many stretches as there are threads: side by side, two threads would wait for the same large page to be
            // cleared, each by itself.
            const std::size_t stretch = (n + count - 1) / count;
            std::atomic<std::size_t> next{0};
            std::atomic<bool> fails{false};
            std::exception_ptr failure;  // the first one, of the thread that set `fails`
            const auto work = [&] {
              try {
                for (std::size_t claim; !fails && (claim = next.fetch_add(1)) < stretch * count;)
                  if (const std::size_t i = claim % count * stretch + claim / count; i < n) body(i);
              } catch (...) {
                if (!fails.exchange(true)) failure = std::current_exception();
              }
            };
            {
              std::vector<std::jthread> others;
              for (std::size_t i = 1; i < count; ++i) others.emplace_back(work);
              work();
            }
            if (failure) std::rethrow_exception(failure);
          }};
}

Tangents compute(const Surface& surface, const Loop& loop) {
  static_assert(sizeof(CornerTangent) == 4 * sizeof(float));
  Tangents out;
  out.corners.resize(surface.indices.size());
  out.counts = computeInto(surface, loop, Output(reinterpret_cast<float*>(out.corners.data()), false), &out.mended);
  return out;
}

ReferenceTangents computeReference(const Surface& surface, const Loop& loop) {
  static_assert(sizeof(ReferenceTangent) == 4 * sizeof(float));
  ReferenceTangents out;
  out.corners.resize(surface.indices.size());
  out.counts = computeInto(surface, loop, Output(reinterpret_cast<float*>(out.corners.data()), true), nullptr);
  return out;
}

}  // namespace lmc::tangent
