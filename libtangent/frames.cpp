#include "libtangent/frames.h"

#include <algorithm>
#include <cstddef>

#include "libtangent/angle.h"
#include "libtangent/four.h"
#include "libtangent/rings.h"
#include "libtangent/simd.h"
#include "libtangent/vectors.h"

namespace lmc::tangent {

namespace {

constexpr std::size_t kBlock = 64;      // triangles side by side: what they need stays in the first cache
constexpr std::size_t kGrain = 4096;    // triangles a piece; a multiple of the block
constexpr float kLeastSquare = 1e-12f;  // of what is left of S in the plane
constexpr float kUnitError = 0.01f;     // of squared lengths
constexpr float kSkew = 0.5f;           // cosine squared of 45 degrees

/// Structure of arrays: triangles as they come, then what comes of them.
struct Block {
  alignas(64) float p[3][3][kBlock], n[3][3][kBlock], uv[3][2][kBlock];  ///< [corner][axis]
  alignas(64) float s[3][kBlock], t[3][kBlock];
  alignas(64) float weighted[3][3][kBlock], cosine[3][kBlock], angle[3][kBlock];
  alignas(64) unsigned doubt[3][kBlock];
  alignas(64) std::uint32_t flags[kBlock];
};

LMC_INLINE bool speaks(float x) { return std::abs(x) > FLT_MIN; }

struct Triangle {
  float p[3][3], uv[3][2];
};
struct Derived {
  float s[3], t[3], ms, mt, absArea;
  bool preserving, good;
};
/// d1, d2: sides in space; (u1, v1), (u2, v2): in UV. A = u1 v2 - v1 u2; s = v2 d1 - v1 d2, t = -u2 d1 + u1 d2: dp/du = s/A, dp/dv = t/A.
LMC_INLINE Derived derive(const Triangle& in) {
  Derived out;
  const float u1 = in.uv[1][0] - in.uv[0][0], v1 = in.uv[1][1] - in.uv[0][1];
  const float u2 = in.uv[2][0] - in.uv[0][0], v2 = in.uv[2][1] - in.uv[0][1];
  const float d1x = in.p[1][0] - in.p[0][0], d1y = in.p[1][1] - in.p[0][1], d1z = in.p[1][2] - in.p[0][2];
  const float d2x = in.p[2][0] - in.p[0][0], d2y = in.p[2][1] - in.p[0][1], d2z = in.p[2][2] - in.p[0][2];
  const float area = u1 * v2 - v1 * u2;
  const float sx = v2 * d1x - v1 * d2x, sy = v2 * d1y - v1 * d2y, sz = v2 * d1z - v1 * d2z;
  const float tx = -u2 * d1x + u1 * d2x, ty = -u2 * d1y + u1 * d2y, tz = -u2 * d1z + u1 * d2z;
  const float ls = std::sqrt(sx * sx + sy * sy + sz * sz), lt = std::sqrt(tx * tx + ty * ty + tz * tz);
  out.absArea = std::abs(area);
  out.preserving = area > 0.0f;
  const float way = out.preserving ? 1.0f : -1.0f;
  out.ms = ls / out.absArea, out.mt = lt / out.absArea;
  out.good = speaks(area) & speaks(out.ms) & speaks(out.mt);
  const bool hasS = out.good & speaks(ls), hasT = out.good & speaks(lt);
  const float gs = way / ls, gt = way / lt;
  out.s[0] = hasS ? gs * sx : 0.0f, out.s[1] = hasS ? gs * sy : 0.0f, out.s[2] = hasS ? gs * sz : 0.0f;
  out.t[0] = hasT ? gt * tx : 0.0f, out.t[1] = hasT ? gt * ty : 0.0f, out.t[2] = hasT ? gt * tz : 0.0f;
  return out;
}

LMC_INLINE void deriveAll(Block& b) {
  for (std::size_t i = 0; i < kBlock; ++i) {
    Triangle in;
    for (int c = 0; c < 3; ++c) {
      for (int axis = 0; axis < 3; ++axis) in.p[c][axis] = b.p[c][axis][i];
      for (int axis = 0; axis < 2; ++axis) in.uv[c][axis] = b.uv[c][axis][i];
    }
    const Derived d = derive(in);
    for (int axis = 0; axis < 3; ++axis) b.s[axis][i] = d.s[axis], b.t[axis][i] = d.t[axis];
    const auto same = [&](int a, int c) __attribute__((always_inline)) {
      return (in.p[a][0] == in.p[c][0]) & (in.p[a][1] == in.p[c][1]) & (in.p[a][2] == in.p[c][2]);
    };
    const bool degenerate = same(0, 1) | same(1, 2) | same(0, 2);
    std::uint32_t shortT = 0;
    for (int axis = 0; axis < 3; ++axis)
      shortT |= (std::uint32_t(std::int32_t(d.t[axis] * kShortSteps)) & ((1u << kShortBits) - 1)) << (kShortShift + kShortBits * axis);
    b.flags[i] = shortT | (d.preserving ? kPreserving : 0u) | (d.good ? 0u : kFrameless) | (degenerate ? kDegenerate : 0u);
  }
}

struct Three {
  float x, y, z;
};
/// inPlane() and unit() of vectors.h, as lanes.
LMC_INLINE Three flat(Three n, Three v) {
  const float d = n.x * v.x + n.y * v.y + n.z * v.z;
  return {v.x - d * n.x, v.y - d * n.y, v.z - d * n.z};
}
LMC_INLINE float square(Three v) { return v.x * v.x + v.y * v.y + v.z * v.z; }
LMC_INLINE Three unitLane(Three v) {
  const bool nonzero = speaks(v.x) | speaks(v.y) | speaks(v.z);
  const float length = std::sqrt(square(v));
  const float scale = 1.0f / (nonzero ? length : 1.0f);
  return {scale * v.x, scale * v.y, scale * v.z};
}

/// What all triangles add at one of their corners.
LMC_INLINE void weighCorner(Block& b, std::uint32_t c) {
  const std::uint32_t next = kNextCorner[c], previous = kPreviousCorner[c];
  for (std::size_t i = 0; i < kBlock; ++i) {
    const Three n{b.n[c][0][i], b.n[c][1][i], b.n[c][2][i]};
    const float x = b.p[c][0][i], y = b.p[c][1][i], z = b.p[c][2][i];
    const Three e1 = unitLane(flat(n, {b.p[previous][0][i] - x, b.p[previous][1][i] - y, b.p[previous][2][i] - z}));
    const Three e2 = unitLane(flat(n, {b.p[next][0][i] - x, b.p[next][1][i] - y, b.p[next][2][i] - z}));
    const float cosine = e1.x * e2.x + e1.y * e2.y + e1.z * e2.z;
    b.cosine[c][i] = cosine > 1.0f ? 1.0f : cosine < -1.0f ? -1.0f : cosine;
    const Three s = flat(n, {b.s[0][i], b.s[1][i], b.s[2][i]});
    const Three u = unitLane(s), t = flat(n, {b.t[0][i], b.t[1][i], b.t[2][i]});
    const float st = u.x * t.x + u.y * t.y + u.z * t.z;
    const float turn = n.x * (u.y * t.z - u.z * t.y) + n.y * (u.z * t.x - u.x * t.z) + n.z * (u.x * t.y - u.y * t.x);
    // Where n is not of unit length, what is left of S and T does not lie in a plane.
    const bool right = ((b.flags[i] & kPreserving ? turn : -turn) > 0.0f) & (std::abs(square(n) - 1.0f) < kUnitError);
    b.flags[i] |= (square(s) > kLeastSquare ? 0u : kUnsteady << c) | (right & (st * st < kSkew * square(t)) ? 0u : kSkewed << c);
    b.weighted[c][0][i] = u.x, b.weighted[c][1][i] = u.y, b.weighted[c][2][i] = u.z;
  }
  angles(b.cosine[c], b.angle[c], b.doubt[c], int(kBlock));
}

LMC_INLINE void multiplyCorner(Block& b, std::uint32_t c) {
  for (std::size_t i = 0; i < kBlock; ++i) {
    const bool framed = (b.flags[i] & kFrameless) == 0;
    const float w = framed ? b.angle[c][i] : 0.0f, x = w * b.weighted[c][0][i], y = w * b.weighted[c][1][i], z = w * b.weighted[c][2][i];
    b.angle[c][i] = w;
    b.weighted[c][0][i] = framed ? x : 0.0f, b.weighted[c][1][i] = framed ? y : 0.0f, b.weighted[c][2][i] = framed ? z : 0.0f;
  }
}

LMC_INLINE void measureAll(Block& b) {
  deriveAll(b);
  for (std::uint32_t c = 0; c < 3; ++c) weighCorner(b, c);
}
LMC_INLINE void multiplyAll(Block& b) {
  for (std::uint32_t c = 0; c < 3; ++c) multiplyCorner(b, c);
}
void measurePlain(Block& b) { measureAll(b); }
void multiplyPlain(Block& b) { multiplyAll(b); }
LMC_AVX2 void measureAvx2(Block& b) { measureAll(b); }
LMC_AVX2 void multiplyAvx2(Block& b) { multiplyAll(b); }

void settleDoubts(Block& b) {
  for (std::uint32_t c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < kBlock; ++i)
      if (b.doubt[c][i]) b.angle[c][i] = float(std::acos(double(b.cosine[c][i])));
}

/// Fills a block four triangles at a time; behind the last one come copies of it.
void gather(const Mesh& m, std::size_t first, std::size_t count, Block& b) {
  for (std::size_t i = 0; i < kBlock; i += 4)
    for (std::size_t c = 0; c < 3; ++c) {
      Four p[4], n[4];
      for (std::size_t k = 0; k < 4; ++k) {
        const Vertex& v = m.vertices[m.ids[3 * (first + std::min(i + k, count - 1)) + c]];
        p[k] = loadFour(&v.position.x);
        n[k] = loadFour(&v.normal.x);
      }
      transpose(p[0], p[1], p[2], p[3]);
      transpose(n[0], n[1], n[2], n[3]);
      for (std::size_t axis = 0; axis < 3; ++axis) storeFour(&b.p[c][axis][i], p[axis]), storeFour(&b.n[c][axis][i], n[axis]);
      storeFour(&b.uv[c][0][i], p[3]);
      storeFour(&b.uv[c][1][i], n[3]);
    }
}

/// Up to four records out of a block; gives back the flags of all, one or the other.
std::uint32_t scatter(const Mesh& m, const Block& b, std::size_t first, std::size_t i, std::size_t count, Frame* out) {
  static_assert(sizeof(Frame) == 64 && offsetof(Frame, ids) == 48);
  Four row[12];
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t axis = 0; axis < 3; ++axis) row[4 * c + axis] = loadFour(&b.weighted[c][axis][i]);
    row[4 * c + 3] = loadFour(&b.angle[c][i]);
  }
  for (std::size_t r = 0; r < 12; r += 4) transpose(row[r], row[r + 1], row[r + 2], row[r + 3]);
  std::uint32_t any = 0;
  for (std::size_t k = 0; k < std::min<std::size_t>(4, count - i); ++k) {
    char* place = reinterpret_cast<char*>(out + first + i + k);
    for (std::size_t part = 0; part < 3; ++part) std::memcpy(place + 16 * part, &row[4 * part + k], 16);
    const std::uint32_t* id = &m.ids[3 * (first + i + k)];
    const std::uint32_t words[4] = {id[0], id[1], id[2], b.flags[i + k]};
    std::memcpy(place + 48, words, 16);
    any |= b.flags[i + k];
  }
  return any;
}

/// Two triangles of a quad run the same way round: the frameless one, else the one smaller in UV, takes the other's.
/// A quad of which one half is degenerate is marked.
void settleQuads(const Mesh& m, Frames& frames) {
  for (std::size_t t = 0; t + 1 < m.faces.size(); ++t) {
    if (m.faces[t] != m.faces[t + 1]) continue;
    Frame &a = frames.of[t], &b = frames.of[t + 1];
    const bool degenerateA = a.flags & kDegenerate, degenerateB = b.flags & kDegenerate;
    if (degenerateA != degenerateB) a.flags |= kLoneHalf, b.flags |= kLoneHalf;
    if (degenerateA || degenerateB || (a.flags & kPreserving) == (b.flags & kPreserving)) continue;
    const bool bFollows = (b.flags & kFrameless) || derivativesOf(m, t).uvArea >= derivativesOf(m, t + 1).uvArea;
    (bFollows ? b : a).flags ^= kPreserving;
  }
}

void framesOfPiece(const Mesh& m, std::size_t from, std::size_t to, Frame* out, std::vector<std::uint32_t>& frameless,
                   std::vector<std::uint32_t>& degenerate) {
  const bool wide = hasAvx2();
  Block b;
  for (std::size_t first = from; first < to; first += kBlock) {
    const std::size_t count = std::min(kBlock, to - first);
    gather(m, first, count, b);
    wide ? measureAvx2(b) : measurePlain(b);
    settleDoubts(b);
    wide ? multiplyAvx2(b) : multiplyPlain(b);
    std::uint32_t special = 0;
    for (std::size_t i = 0; i < count; i += 4) special |= scatter(m, b, first, i, count, out);
    if (!(special & (kFrameless | kDegenerate))) continue;
    for (std::size_t i = 0; i < count; ++i) {
      if (b.flags[i] & kDegenerate)
        degenerate.push_back(std::uint32_t(first + i));
      else if (b.flags[i] & kFrameless)
        frameless.push_back(std::uint32_t(first + i));
    }
  }
}

}  // namespace

Derivatives derivativesOf(const Mesh& m, std::size_t triangle) {
  Triangle in;
  for (std::size_t c = 0; c < 3; ++c) {
    const Vertex& v = m.vertices[m.ids[3 * triangle + c]];
    for (int axis = 0; axis < 3; ++axis) in.p[c][axis] = v.position[axis];
    in.uv[c][0] = v.u, in.uv[c][1] = v.v;
  }
  const Derived d = derive(in);
  return {{d.s[0], d.s[1], d.s[2]}, {d.t[0], d.t[1], d.t[2]}, d.ms, d.mt, d.absArea};
}

Frames framesOf(const Mesh& m, const Loop& loop) {
  Frames frames;
  const std::size_t n = m.triangleCount(), grains = (n + kGrain - 1) / kGrain;
  frames.of.resize(n);
  std::vector<std::vector<std::uint32_t>> frameless(grains), degenerate(grains);
  pieces(loop, n, kGrain, [&](std::size_t from, std::size_t to) {
    framesOfPiece(m, from, to, frames.of.data(), frameless[from / kGrain], degenerate[from / kGrain]);
  });
  for (std::size_t g = 0; g < grains; ++g) {
    frames.frameless.insert(frames.frameless.end(), frameless[g].begin(), frameless[g].end());
    frames.degenerate.insert(frames.degenerate.end(), degenerate[g].begin(), degenerate[g].end());
  }
  if (m.hasQuads()) settleQuads(m, frames);
  return frames;
}

}  // namespace lmc::tangent
