/// Same bytes for any number of threads; rules that settle a pair without a ray are never wrong.
#include <gtest/gtest.h>

#include <cstring>

#include "libradiosity/solve_links.h"
#include "libradiosity/solve_stored.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"
#include "libscene/texels.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

void box(test::SceneBuilder& s, glm::vec3 lo, glm::vec3 d, std::uint32_t m) {
  const glm::vec3 X(d.x, 0, 0), Y(0, d.y, 0), Z(0, 0, d.z);
  s.quad(lo, Z, Y, m);
  s.quad(lo + X, Y, Z, m);
  s.quad(lo, Y, X, m);
  s.quad(lo + Z, X, Y, m);
  s.quad(lo, X, Z, m);
  s.quad(lo + Y, Z, X, m);
}

Scene roomsWithDoors() {
  test::SceneBuilder s(8);
  const auto white = s.material(Rgb(0.7f)), lamp = s.material(Rgb(0.0f), Rgb(5.0f));
  s.room({0, 0, 0}, {9, 2.5f, 3}, {white, white, white, white, white, white});
  box(s, {2.9f, 0, 1}, {0.2f, 2.5f, 2}, white);
  box(s, {5.9f, 0, 0}, {0.2f, 2.5f, 2}, white);
  s.quad({1, 2.4f, 1}, {1, 0, 0}, {0, 0, 1}, lamp);
  return s.scene;
}
Scene columns() {
  test::SceneBuilder s(16);
  const auto white = s.material(Rgb(0.7f)), lamp = s.material(Rgb(0.0f), Rgb(5.0f));
  s.room({0, 0, 0}, {12, 4, 8}, {white, white, white, white, white, white});
  for (int x = 0; x < 3; ++x)
    for (int z = 0; z < 2; ++z) box(s, {2.7f + 3.0f * float(x), 0, 2.2f + 3.0f * float(z)}, {0.6f, 4, 0.6f}, white);
  s.quad({5, 3.9f, 3}, {1, 0, 0}, {0, 0, 1}, lamp);
  return s.scene;
}
Scene outdoors() {
  test::SceneBuilder s(16);
  const auto white = s.material(Rgb(0.5f));
  s.quad({-10, 0, -10}, {0, 0, 20}, {20, 0, 0}, white);
  for (int k = 0; k < 5; ++k) box(s, {-8.0f + 3.5f * float(k), 0, -4.0f + float(k)}, {2, 2.0f + float(k), 1.5f}, white);
  s.scene.sky = Rgb(1.0f);
  return s.scene;
}

class Scenes : public testing::TestWithParam<int> {
 protected:
  static Scene make(int i) { return i == 0 ? roomsWithDoors() : i == 1 ? columns() : outdoors(); }
};

TEST_P(Scenes, SameBytesForAnyNumberOfThreads) {
  const Scene scene = make(GetParam());
  std::array<Bounced, 2> stored, links;
  for (const int threads : {1, 2}) {
    lmc::Run run;
    run.threads = threads;
    withThreads(run, [&] {
      const Tracer tracer(scene);
      const DirectLight direct(scene, tracer, true);
      PatchMesh mesh = makePatches(scene, {.size_m = 0.6}, run);
      exposePatches(mesh, scene, tracer, run);
      const PatchLight light = lightPatches(scene, tracer, mesh, direct, {}, run);
      stored[std::size_t(threads) - 1] = solveStored(scene, tracer, mesh, light, {}, run).solution.illuminance;
      HierarchicalOptions o;
      o.goal = 0.08;
      links[std::size_t(threads) - 1] = solveHierarchical(scene, tracer, mesh, light, o, run).fine.illuminance;
    });
  }
  EXPECT_EQ(std::memcmp(stored[0].data(), stored[1].data(), stored[0].size() * sizeof(Rgb)), 0);
  EXPECT_EQ(std::memcmp(links[0].data(), links[1].data(), links[0].size() * sizeof(Rgb)), 0);
}

TEST_P(Scenes, StoredRaysGiveTheSameBytesWhateverIsKeptOfThem) {
  const Scene scene = make(GetParam());
  const lmc::Run run;
  const Tracer tracer(scene);
  const DirectLight direct(scene, tracer, true);
  PatchMesh mesh = makePatches(scene, {.size_m = 0.6}, run);
  exposePatches(mesh, scene, tracer, run);
  const PatchLight light = lightPatches(scene, tracer, mesh, direct, {}, run);
  const StoredSolution all = solveStored(scene, tracer, mesh, light, {}, run);
  const std::uint64_t rays = tracer.rays(Purpose::Shoot);
  for (const std::uint64_t bytes : {6 * rays, std::uint64_t(0)}) {  // hits one way; none, cast again in every sweep
    const StoredSolution s = solveStored(scene, tracer, mesh, light, {.maxBytes = bytes}, run);
    EXPECT_LT(s.bytes, all.bytes);
    EXPECT_EQ(s.solution.passes, all.solution.passes);
    EXPECT_EQ(std::memcmp(s.solution.illuminance.data(), all.solution.illuminance.data(), mesh.patches.size() * sizeof(Rgb)), 0) << bytes;
  }
}

/// Random pairs of nodes that a rule settles, random rays between them: Embree's robust rays are the oracle.
TEST_P(Scenes, NoRuleSettlesAPairFalsely) {
  const Scene scene = make(GetParam());
  const lmc::Run run;
  const Tracer tracer(scene);
  PatchMesh mesh = makePatches(scene, {.size_m = 0.6}, run);
  exposePatches(mesh, scene, tracer, run);
  const ClusterTree tree = makeClusters(scene, mesh, run);
  const Partition partition(scene, mesh, tree, tracer, {}, run);
  const Sobol4 pairs(1), ends(2);
  std::array<std::uint64_t, kRules> settled{}, wrong{};
  std::uint64_t rays = 0;
  std::uint32_t index = 0;
  for (std::uint32_t n = 0; rays < 350'000 && n < 400'000; ++n) {
    const glm::vec4 u = pairs.point(n);
    const auto a = std::uint32_t(double(u.x) * double(tree.nodes.size())), b = std::uint32_t(double(u.y) * double(tree.nodes.size()));
    const Cluster &ca = tree.nodes[a], &cb = tree.nodes[b];
    if (a == b || !(ca.area_m2 > 0.0) || !(cb.area_m2 > 0.0)) continue;
    const bool averted = partition.averted(ca, cb), empty = !averted && partition.emptyShaft(ca, cb),
               blocked = !averted && partition.blockedShaft(ca, cb);
    if (!averted && !empty && !blocked) continue;
    settled[std::size_t(Rule::Facing)] += averted;
    settled[std::size_t(Rule::Empty)] += empty;
    settled[std::size_t(Rule::Blocked)] += blocked;
    for (int k = 0; k < 16; ++k) {
      const glm::vec4 w = ends.point(index++);
      const auto at = [&](const Cluster& c, float x, float y) {
        const auto [i, rest] = tree.pick(c, x);
        const Patch& p = mesh.patches[tree.order[i]];
        const auto [t, bary] = mesh.sample(p, {rest, y});
        SurfacePoint s = surfacePoint(scene, t, bary);
        if (p.back) s.geometricNormal = -s.geometricNormal;
        return s;
      };
      const SurfacePoint p = at(ca, w.x, w.y), q = at(cb, w.z, w.w);
      const glm::dvec3 r = glm::normalize(q.position_m - p.position_m);
      ++rays;
      // Facing: cosines of both sides positive beyond rounding.
      const double c1 = glm::dot(r, p.geometricNormal), c2 = -glm::dot(r, q.geometricNormal);
      if (averted) wrong[std::size_t(Rule::Facing)] += c1 > 1e-4 && c2 > 1e-4;
      if (!(c1 > 1e-4) || !(c2 > 1e-4)) continue;
      const glm::vec3 from = tracer.lifted(p.position_m, p.geometricNormal), to = tracer.lifted(q.position_m, q.geometricNormal);
      const bool hidden = tracer.occluded(Ray{from, to - from, 1.0f}, Purpose::Visibility);
      if (empty) wrong[std::size_t(Rule::Empty)] += hidden;
      if (blocked) wrong[std::size_t(Rule::Blocked)] += !hidden;
    }
  }
  EXPECT_GE(rays, 100'000u);
  for (std::size_t r = 0; r < kRules; ++r) EXPECT_EQ(wrong[r], 0u) << kRuleNames[r] << " of " << settled[r];
  for (const Rule r : {Rule::Facing, Rule::Empty, Rule::Blocked}) EXPECT_GT(settled[std::size_t(r)], 100u) << kRuleNames[std::size_t(r)];
}

INSTANTIATE_TEST_SUITE_P(Of, Scenes, testing::Values(0, 1, 2), [](const auto& i) {
  return std::string(i.param == 0 ? "Rooms" : i.param == 1 ? "Columns" : "Outdoors");
});

}  // namespace
}  // namespace lmc
