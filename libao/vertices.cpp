#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <unordered_map>

#include "libao/rounds.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"

namespace lmc::ao {

namespace {

constexpr std::uint32_t kPoolSize = 16;           // vertices after each other
constexpr std::uint32_t kVertexRow = 0xfffffffe;  // their random numbers are no texel's

/// A corner of a triangle.
struct Corner {
  std::uint32_t triangle, corner;
};

/// Vertices of equal position and normal have one entry, which all of their triangles' corners belong to.
struct Entries {
  std::vector<std::uint32_t> of;  ///< one a vertex; kNone where no triangle that receives light uses it
  std::vector<std::uint32_t> first{0};
  std::vector<Corner> corners;     ///< of entry e: [first[e], first[e + 1])
  std::vector<double> reached_m2;  ///< area of them up to and with this one
  std::size_t count() const { return first.size() - 1; }
};

std::uint64_t hashOf(const glm::vec3& v, std::uint64_t h) {
  for (int k = 0; k < 3; ++k) {
    const float f = v[k] + 0.0f;  // -0 is 0
    std::uint32_t bits;
    std::memcpy(&bits, &f, sizeof bits);
    h = combine(h, bits);
  }
  return h;
}

Entries entriesOf(const Scene& scene) {
  Entries out;
  out.of.assign(scene.positions_m.size(), kNone);
  std::unordered_map<std::uint64_t, std::uint32_t> known;
  std::vector<std::uint32_t> size;
  const auto wanted = [&](std::uint32_t t) { return scene.objectOf(t).receive; };
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t)
    for (int c = 0; c < 3 && wanted(t); ++c) {
      const std::uint32_t v = scene.triangles[t][c];
      if (out.of[v] == kNone) {
        const std::uint64_t key = hashOf(scene.normals[v], hashOf(scene.positions_m[v], 0));
        const auto [it, fresh] = known.try_emplace(key, std::uint32_t(size.size()));
        if (fresh) size.push_back(0);
        out.of[v] = it->second;
      }
      ++size[out.of[v]];
    }
  for (const std::uint32_t n : size) out.first.push_back(out.first.back() + n);
  out.corners.resize(out.first.back());
  std::vector<std::uint32_t> next(out.first.begin(), out.first.end() - 1);
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t)
    for (std::uint32_t c = 0; c < 3 && wanted(t); ++c) out.corners[next[out.of[scene.triangles[t][int(c)]]]++] = {t, c};
  out.reached_m2.resize(out.corners.size());
  for (std::size_t e = 0; e < out.count(); ++e) {
    double sum = 0.0;
    for (std::uint32_t k = out.first[e]; k < out.first[e + 1]; ++k)
      out.reached_m2[k] = sum += area_m2(scene.corners_m(out.corners[k].triangle));
  }
  return out;
}

/// A place of the triangles round an entry, its density in proportion to the entry's barycentric weight.
SurfacePoint placeRound(const Scene& scene, const Entries& entries, std::size_t e, glm::vec2 u) {
  const std::uint32_t first = entries.first[e], end = entries.first[e + 1];
  const double wish = double(u.x) * entries.reached_m2[end - 1];
  const auto reached = entries.reached_m2.begin();
  const auto k = std::uint32_t(std::upper_bound(reached + first, reached + end - 1, wish) - reached);
  const double before = k > first ? entries.reached_m2[k - 1] : 0.0, own = entries.reached_m2[k] - before;
  const double rest = own > 0.0 ? std::clamp((wish - before) / own, 0.0, 1.0) : 0.5;
  // Of a linear weight over a triangle the share w has the density 6 w (1 - w), and so the distribution 3 w^2 - 2 w^3 = rest.
  const double w = 0.5 - std::sin(std::asin(1.0 - 2.0 * rest) / 3.0), v = (1.0 - w) * double(u.y);
  double share[3];
  share[entries.corners[k].corner] = w;
  share[(entries.corners[k].corner + 1) % 3] = v;
  share[(entries.corners[k].corner + 2) % 3] = 1.0 - w - v;
  return surfacePoint(scene, entries.corners[k].triangle, {share[1], share[2]});
}

}  // namespace

Openness bakeVertices(const Scene& scene, const Tracer& tracer, const Options& options, const Run& run) {
  const Entries entries = entriesOf(scene);
  const std::size_t n = entries.count();
  std::vector<std::uint32_t> poolOf(n);
  for (std::size_t e = 0; e < n; ++e) poolOf[e] = entries.reached_m2[entries.first[e + 1] - 1] > 0.0 ? std::uint32_t(e / kPoolSize) : kNone;
  std::vector<Sums> sums(n);
  std::vector<glm::vec3> bent(options.bent ? n : 0, glm::vec3(0.0f));
  const Hemisphere hemisphere(tracer, options);
  const auto cast = [&](std::span<const std::uint32_t> wanted, double from, double to) {
    std::vector<std::uint64_t> rays(n, 0);
    parallelFor(run.part(from, to), n, 64, [&](std::size_t e) {
      if (wanted[e] <= sums[e].rays) return;
      const Places places{[&](glm::vec2 u) { return placeRound(scene, entries, e, u); }};
      glm::vec3* open = bent.empty() ? nullptr : &bent[e];
      if (open && sums[e].rays == 0) *open = kNextToNothing * glm::vec3(places.at(glm::vec2(0.5f)).normal);
      rays[e] = hemisphere.cast(addressOf(run.seed, std::uint32_t(e), kVertexRow), wanted[e], places, sums[e], open);
    });
    return std::accumulate(rays.begin(), rays.end(), std::uint64_t(0));
  };
  const Openness all = castInRounds(options, sums, poolOf, std::uint32_t(n / kPoolSize + 1), cast);

  Openness out = all;
  const auto spread = [&](const auto& from, auto& to) {
    to.assign(entries.of.size(), {});
    for (std::size_t v = 0; v < to.size(); ++v)
      if (entries.of[v] != kNone) to[v] = from[entries.of[v]];
  };
  spread(all.cosine, out.cosine);
  spread(all.uniform, out.uniform);
  spread(all.error, out.error);
  if (options.bent) spread(bent, out.bent);
  unitAll(out.bent);
  return out;
}

}  // namespace lmc::ao
