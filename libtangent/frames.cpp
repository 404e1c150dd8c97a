#include "libtangent/frames.h"

#include <algorithm>

#include "libtangent/simd.h"
#include "libtangent/vectors.h"

namespace lmc::tangent {

namespace {

constexpr std::size_t kBlock = 64;    // triangles side by side
constexpr std::size_t kGrain = 8192;  // triangles a piece; a multiple of the block

/// Structure of arrays: corner 0 and the two sides from it, then what comes of them.
struct Block {
  alignas(64) float p[3][3][kBlock];  ///< [corner][axis]
  alignas(64) float uv[3][2][kBlock];
  alignas(64) float s[3][kBlock], t[3][kBlock], area[kBlock], ms[kBlock], mt[kBlock];
  alignas(64) std::uint32_t flags[kBlock];
};

LMC_INLINE bool speaks(float x) { return std::abs(x) > FLT_MIN; }

/// d1, d2: sides in space; (u1, v1), (u2, v2): in UV. A = u1 v2 - v1 u2; s = v2 d1 - v1 d2, t = -u2 d1 + u1 d2: dp/du = s/A, dp/dv = t/A.
LMC_INLINE void deriveAll(Block& b) {
  for (std::size_t i = 0; i < kBlock; ++i) {
    const float u1 = b.uv[1][0][i] - b.uv[0][0][i], v1 = b.uv[1][1][i] - b.uv[0][1][i];
    const float u2 = b.uv[2][0][i] - b.uv[0][0][i], v2 = b.uv[2][1][i] - b.uv[0][1][i];
    const float d1x = b.p[1][0][i] - b.p[0][0][i], d1y = b.p[1][1][i] - b.p[0][1][i], d1z = b.p[1][2][i] - b.p[0][2][i];
    const float d2x = b.p[2][0][i] - b.p[0][0][i], d2y = b.p[2][1][i] - b.p[0][1][i], d2z = b.p[2][2][i] - b.p[0][2][i];
    const float area = u1 * v2 - v1 * u2;
    const float sx = v2 * d1x - v1 * d2x, sy = v2 * d1y - v1 * d2y, sz = v2 * d1z - v1 * d2z;
    const float tx = -u2 * d1x + u1 * d2x, ty = -u2 * d1y + u1 * d2y, tz = -u2 * d1z + u1 * d2z;
    const float ls = std::sqrt(sx * sx + sy * sy + sz * sz), lt = std::sqrt(tx * tx + ty * ty + tz * tz);
    const float absArea = std::abs(area), way = area > 0.0f ? 1.0f : -1.0f;
    const float ms = ls / absArea, mt = lt / absArea;
    const bool good = speaks(area) & speaks(ms) & speaks(mt);
    const float gs = good & speaks(ls) ? way / ls : 0.0f, gt = good & speaks(lt) ? way / lt : 0.0f;
    b.s[0][i] = gs != 0.0f ? gs * sx : 0.0f, b.s[1][i] = gs != 0.0f ? gs * sy : 0.0f, b.s[2][i] = gs != 0.0f ? gs * sz : 0.0f;
    b.t[0][i] = gt != 0.0f ? gt * tx : 0.0f, b.t[1][i] = gt != 0.0f ? gt * ty : 0.0f, b.t[2][i] = gt != 0.0f ? gt * tz : 0.0f;
    b.area[i] = absArea, b.ms[i] = ms, b.mt[i] = mt;
    const auto same = [&](int a, int c) __attribute__((always_inline)) {
      return (b.p[a][0][i] == b.p[c][0][i]) & (b.p[a][1][i] == b.p[c][1][i]) & (b.p[a][2][i] == b.p[c][2][i]);
    };
    const bool degenerate = same(0, 1) | same(1, 2) | same(0, 2);
    b.flags[i] = (area > 0.0f ? kPreserving : 0u) | (good ? 0u : kFrameless) | (degenerate ? kDegenerate : 0u);
  }
}
void derivePlain(Block& b) { deriveAll(b); }
LMC_AVX2 void deriveAvx2(Block& b) { deriveAll(b); }

void gather(const Mesh& m, std::size_t first, std::size_t count, Block& b) {
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t c = 0; c < 3; ++c) {
      const std::uint32_t id = m.ids[3 * (first + i) + c];
      const glm::vec3 p = m.positions[id];
      const glm::vec2 t = m.uvs[id];
      b.p[c][0][i] = p.x, b.p[c][1][i] = p.y, b.p[c][2][i] = p.z;
      b.uv[c][0][i] = t.x, b.uv[c][1][i] = t.y;
    }
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
    const bool bFollows = (b.flags & kFrameless) || a.uvArea >= b.uvArea;
    (bFollows ? b : a).flags ^= kPreserving;
  }
}

}  // namespace

Frames framesOf(const Mesh& m, const Loop& loop) {
  Frames frames;
  const std::size_t n = m.triangleCount(), grains = (n + kGrain - 1) / kGrain;
  frames.of.resize(n);
  if (m.hasQuads()) frames.magnitudes.resize(n);
  std::vector<std::vector<std::uint32_t>> frameless(grains), degenerate(grains);
  const bool wide = hasAvx2();
  pieces(loop, n, kGrain, [&](std::size_t from, std::size_t to) {
    Block b{};
    for (std::size_t first = from; first < to; first += kBlock) {
      const std::size_t count = std::min(kBlock, to - first);
      gather(m, first, count, b);
      wide ? deriveAvx2(b) : derivePlain(b);
      std::uint32_t special = 0;
      for (std::size_t i = 0; i < count; ++i) {
        frames.of[first + i] = {{b.s[0][i], b.s[1][i], b.s[2][i]}, b.flags[i], {b.t[0][i], b.t[1][i], b.t[2][i]}, b.area[i]};
        special |= b.flags[i];
      }
      if (m.hasQuads())
        for (std::size_t i = 0; i < count; ++i) frames.magnitudes[first + i] = {b.ms[i], b.mt[i]};
      if (special & (kFrameless | kDegenerate))
        for (std::size_t i = 0; i < count; ++i) {
          if (b.flags[i] & kDegenerate)
            degenerate[from / kGrain].push_back(std::uint32_t(first + i));
          else if (b.flags[i] & kFrameless)
            frameless[from / kGrain].push_back(std::uint32_t(first + i));
        }
    }
  });
  for (std::size_t g = 0; g < grains; ++g) {
    frames.frameless.insert(frames.frameless.end(), frameless[g].begin(), frameless[g].end());
    frames.degenerate.insert(frames.degenerate.end(), degenerate[g].begin(), degenerate[g].end());
  }
  if (m.hasQuads()) settleQuads(m, frames);
  return frames;
}

}  // namespace lmc::tangent
