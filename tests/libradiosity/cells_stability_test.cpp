/// Rooms and portals: apart only where no ray gets through, wherever and however large the level is.
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <glm/gtc/matrix_transform.hpp>
#include <random>

#include "libradiosity/partition.h"
#include "libradiosity/solve_links.h"
#include "libscene/rng.h"
#include "libscene/sampling.h"
#include "libscene/texels.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

void box(test::SceneBuilder& s, glm::vec3 lo, glm::vec3 hi, std::uint32_t m, int cuts = 1) {
  const glm::vec3 d = hi - lo, X(d.x, 0, 0), Y(0, d.y, 0), Z(0, 0, d.z);
  s.quad(lo, Z, Y, m, cuts);
  s.quad(lo + X, Y, Z, m, cuts);
  s.quad(lo, Y, X, m, cuts);
  s.quad(lo + Z, X, Y, m, cuts);
  s.quad(lo, X, Z, m, cuts);
  s.quad(lo + Y, Z, X, m, cuts);
}

/// Moves, scales and turns a level as a loader would: every vertex rounded to float.
Scene placed(Scene s, double scale, glm::dvec3 at_m, double turn_rad = 0.0) {
  const glm::dmat3 turn(glm::rotate(glm::dmat4(1.0), turn_rad, glm::normalize(glm::dvec3(1.0, 2.0, 0.5))));
  s.extent_m = 0.0f;
  for (glm::vec3& p : s.positions_m) {
    p = glm::vec3(scale * (turn * glm::dvec3(p)) + at_m);
    for (int k = 0; k < 3; ++k) s.extent_m = std::max(s.extent_m, std::abs(p[k]));
  }
  for (glm::vec3& n : s.normals) n = glm::vec3(turn * glm::dvec3(n));
  return s;
}

struct Doorway {
  float width = 0.0f;  // 0 = the wall is closed
  float gap = 0.0f;    // below the ceiling
};

/// Two rooms of 3 x 2.5 x 3 m, a wall of 0.1 m between them.
Scene twoRooms(Doorway door, int cuts = 1, std::uint32_t* wallMaterial = nullptr) {
  test::SceneBuilder s(8);
  const auto white = s.material(Rgb(0.7f)), wall = s.material(Rgb(0.6f)), lamp = s.material(Rgb(0.0f), Rgb(5.0f));
  if (wallMaterial) *wallMaterial = wall;
  s.room({0, 0, 0}, {6.125f, 2.5f, 3}, {white, white, white, white, white, white}, cuts);
  box(s, {3, 0, door.width}, {3.125f, 2.5f - door.gap, 3}, wall, cuts);
  s.quad({1, 2.4f, 1}, {1, 0, 0}, {0, 0, 1}, lamp);
  return s.scene;
}

/// Rooms of 3 m in a row along x, doors of 0.8 m at z = 0 and z = 3 in turns.
Scene chain(int rooms) {
  test::SceneBuilder s(16);
  const auto white = s.material(Rgb(0.7f)), lamp = s.material(Rgb(0.0f), Rgb(5.0f));
  s.room({0, 0, 0}, {3.0f * float(rooms), 2.5f, 3}, {white, white, white, white, white, white});
  for (int k = 1; k < rooms; ++k) {
    const float x = 3.0f * float(k), z = k % 2 == 1 ? 0.8f : 0.0f;
    box(s, {x, 0, z}, {x + 0.125f, 2.5f, z + 2.2f}, white);
  }
  s.quad({1, 2.4f, 1}, {1, 0, 0}, {0, 0, 1}, lamp);
  return s.scene;
}

/// Clusters and the rule of cells alone.
struct Rooms {
  explicit Rooms(Scene s, double size = 0.6)
      : scene(std::move(s)),
        tracer(scene),
        mesh(patchesOf(scene, size)),
        tree(makeClusters(scene, mesh, run)),
        partition(makePartition()) {}

  bool apart(std::uint32_t patchA, std::uint32_t patchB) const { return partition.apart(tree.leafOf[patchA], tree.leafOf[patchB]); }

  /// Share of the pairs of patches, one of each part of the level, that are apart. `in`: the number of the part, negative = none.
  double shareApart(int a, int b, const std::function<int(const Cluster&)>& in) const {
    std::uint64_t all = 0, no = 0;
    for (std::uint32_t i = 0; i < mesh.patches.size(); ++i)
      for (std::uint32_t j = 0; j < mesh.patches.size(); ++j) {
        const std::uint32_t p = tree.leafOf[i], q = tree.leafOf[j];
        if (in(tree.nodes[p]) != a || in(tree.nodes[q]) != b) continue;
        ++all;
        no += partition.apart(p, q);
        EXPECT_EQ(partition.apart(p, q), partition.apart(q, p));
      }
    EXPECT_GT(all, 100u);
    return double(no) / double(all);
  }

  struct Rays {
    std::uint64_t pairs = 0, cast = 0, through = 0;
    std::uint64_t open = 0;  // of those that got through: by more than a crack of rounding
  };
  /// Rays between places of random nodes that are apart, 16 a pair: Embree's robust rays are the oracle.
  Rays castBetweenNodesApart(std::uint64_t rays, std::uint32_t tries, std::uint64_t seed) const {
    Rays out;
    const Sobol4 pairs(seed), ends(seed + 1);
    std::uint32_t index = 0;
    for (std::uint32_t n = 0; n < tries && out.cast < rays; ++n) {
      const glm::vec4 u = pairs.point(n);
      const auto a = std::uint32_t(double(u.x) * double(tree.nodes.size())), b = std::uint32_t(double(u.y) * double(tree.nodes.size()));
      if (!(tree.nodes[a].area_m2 > 0.0) || !(tree.nodes[b].area_m2 > 0.0) || !partition.apart(a, b)) continue;
      ++out.pairs;
      for (int k = 0; k < 16; ++k) {
        const glm::vec4 w = ends.point(index++);
        const auto [from, fromNormal] = place(tree.nodes[a], w.x, w.y);
        const auto [to, toNormal] = place(tree.nodes[b], w.z, w.w);
        // Cosines of both sides positive beyond rounding: what lies in one plane may graze along it.
        const glm::dvec3 r = glm::normalize(to - from);
        if (!(glm::dot(r, fromNormal) > 1e-4) || !(glm::dot(r, toNormal) < -1e-4)) continue;
        const glm::vec3 start = tracer.lifted(from, fromNormal), end = tracer.lifted(to, toNormal);
        ++out.cast;
        if (tracer.occluded(Ray{start, end - start, 1.0f}, Purpose::Visibility)) continue;
        ++out.through;
        // Through what is wider than a crack, rays to all four sides of it get as well.
        const glm::dmat3 frame = frameAbout(r);
        bool open = true;
        for (const glm::dvec3& side : {frame[0], -frame[0], frame[1], -frame[1]}) {
          const auto off = glm::vec3(16.0 * double(tracer.lift_m()) * side);
          open = open && !tracer.occluded(Ray{start + off, end - start, 1.0f}, Purpose::Visibility);
        }
        out.open += open;
      }
    }
    return out;
  }

  const lmc::Run run;
  Scene scene;
  Tracer tracer;
  PatchMesh mesh;
  ClusterTree tree;
  Partition partition;

 private:
  PatchMesh patchesOf(const Scene& s, double size) const {
    PatchMesh m = makePatches(s, {.size_m = size}, run);
    exposePatches(m, s, tracer, run);
    return m;
  }
  Partition makePartition() const {
    PartitionOptions o;
    o.on = {false, true, false, false};
    return Partition(scene, mesh, tree, tracer, o, run);
  }
  std::pair<glm::dvec3, glm::dvec3> place(const Cluster& c, float x, float y) const {
    const auto [i, rest] = tree.pick(c, x);
    const Patch& p = mesh.patches[tree.order[i]];
    const auto [t, bary] = mesh.sample(p, {rest, y});
    const SurfacePoint s = surfacePoint(scene, t, bary);
    return {s.position_m, p.back ? -s.geometricNormal : s.geometricNormal};
  }
};

/// Of twoRooms: 0 and 1; patches that reach under the wall are of neither.
int side(const Cluster& c) { return c.hi_m.x < 3.01f ? 0 : c.lo_m.x > 3.11f ? 1 : -1; }

TEST(Cells, TwoClosedRoomsAreApart) {
  const Rooms r(twoRooms({}));
  EXPECT_EQ(r.shareApart(0, 1, side), 1.0);
  EXPECT_EQ(r.shareApart(0, 0, side), 0.0);
  EXPECT_EQ(r.shareApart(1, 1, side), 0.0);
}

TEST(Cells, ADoorwayJoinsTwoRooms) {
  const Rooms r(twoRooms({.width = 0.9f}));
  // What the doorway cannot show stays apart: the faces of the wall itself, the end walls' far corners. Most is in sight of something.
  EXPECT_LT(r.shareApart(0, 1, side), 0.5);
}

TEST(Cells, AGapBelowTheCeilingJoinsTwoRooms) {
  // 1 mm; cracks of up to 8 ulp of the level's extent (6 um here) are rounding.
  const Rooms r(twoRooms({.gap = 0.001f}));
  for (std::uint32_t i = 0; i < r.mesh.patches.size(); ++i) {
    const Cluster& c = r.tree.nodes[r.tree.leafOf[i]];
    if (side(c) != 0 || c.axis.y > -0.5f || c.lo_m.y < 2.49f) continue;
    // A ceiling patch sees through the gap what lies just below the ceiling beyond.
    bool any = false;
    for (std::uint32_t j = 0; j < r.mesh.patches.size(); ++j) any = any || (side(r.tree.nodes[r.tree.leafOf[j]]) == 1 && !r.apart(i, j));
    EXPECT_TRUE(any) << i;
  }
}

TEST(Cells, WallsThatLetLightThroughJoinTwoRooms) {
  std::uint32_t wall = 0;
  const auto with = [&](const std::function<void(Scene&, Material&)>& change) {
    Scene s = twoRooms({}, 1, &wall);
    change(s, s.materials[wall]);
    return s;
  };
  EXPECT_FALSE(Rooms(with([](Scene&, Material& m) { m.alpha = Material::Alpha::Mask; })).partition.hasRooms());
  EXPECT_FALSE(Rooms(with([](Scene&, Material& m) { m.alpha = Material::Alpha::Blend; })).partition.hasRooms());
  EXPECT_FALSE(Rooms(with([](Scene&, Material& m) { m.transmissive = true; })).partition.hasRooms());
  EXPECT_FALSE(Rooms(with([&](Scene& s, Material&) {
                 for (Object& o : s.objects)
                   if (o.material == wall) o.cast = false;
               })).partition.hasRooms());
}

TEST(Cells, RoomsStayApartWhereverTheLevelIsAndHoweverLarge) {
  for (const double scale : {1e-3, 1.0, 1e3}) {
    const Rooms r(placed(twoRooms({}), scale, {}), 0.6 * scale);
    const auto scaled = [&](const Cluster& c) { return double(c.hi_m.x) < 3.01 * scale ? 0 : double(c.lo_m.x) > 3.11 * scale ? 1 : -1; };
    EXPECT_EQ(r.shareApart(0, 1, scaled), 1.0) << scale;
  }
  // 1e5 m off, vertices on a raster of 1/128 m: a crack of 8 ulp is 0.1 m there, and so the wall is a rounding thick.
  const Rooms far(placed(twoRooms({}), 1.0, {1e5, -1e5, 1e5}));
  const auto moved = [](const Cluster& c) { return double(c.hi_m.x) - 1e5 < 3.01 ? 0 : double(c.lo_m.x) - 1e5 > 3.11 ? 1 : -1; };
  EXPECT_EQ(far.shareApart(0, 1, moved), 1.0);
  EXPECT_FALSE(Rooms(placed(twoRooms({.width = 0.9f}), 1.0, {1e5, -1e5, 1e5})).shareApart(0, 1, moved) == 1.0);
}

TEST(Cells, RoomsOfATurnedLevelOfManyTrianglesAreApart) {
  const glm::dmat3 turn(glm::rotate(glm::dmat4(1.0), 0.3, glm::normalize(glm::dvec3(1.0, 2.0, 0.5))));
  const Rooms r(placed(twoRooms({}, 12), 1.0, {20.0, -7.0, 3.0}, 0.3));
  // The middle of each patch in the level as it was made, and no part of it beyond the wall.
  const auto before = [&](const Cluster& c) {
    const double x = (glm::transpose(turn) * (glm::dvec3(c.centre_m) - glm::dvec3(20.0, -7.0, 3.0))).x;
    return x + double(c.radius_m) < 3.01 ? 0 : x - double(c.radius_m) > 3.11 ? 1 : -1;
  };
  EXPECT_EQ(r.shareApart(0, 1, before), 1.0);
}

TEST(Cells, NoLineJoinsRoomsThreeDoorsApart) {
  // Doors at z = 0 .. 0.8 and 2.2 .. 3 in turns, 3 m apart: a line may pass two of them, and no line three.
  const Rooms r(chain(16));
  const auto room = [](const Cluster& c) {
    const double first = std::floor((double(c.lo_m.x) + 0.01) / 3.0), last = std::floor((double(c.hi_m.x) - 0.14) / 3.0);
    // Neither in a door nor under a wall.
    return first == last && double(c.lo_m.x) > 3.0 * first + (first > 0.0 ? 0.12 : -0.1) && double(c.hi_m.x) < 3.0 * first + 3.01
               ? int(first)
               : -1;
  };
  EXPECT_LT(r.shareApart(4, 5, room), 0.5);
  EXPECT_LT(r.shareApart(4, 6, room), 1.0);
  EXPECT_EQ(r.shareApart(4, 4, room), 0.0);
  for (const auto& [a, b] : {std::pair{0, 3}, {4, 7}, {4, 8}, {0, 15}, {12, 2}}) EXPECT_EQ(r.shareApart(a, b, room), 1.0) << a << " " << b;
}

TEST(Cells, ABentCorridorHidesItsEnds) {
  // A corridor of 1.5 m: along z, round a corner along x, round another along z, round a third along x again. What gets round the first two
  // rises by a quarter at most and is at the far wall long before the third.
  test::SceneBuilder s(32);
  const auto white = s.material(Rgb(0.7f));
  s.room({0, 0, 0}, {12, 2.5f, 12}, {white, white, white, white, white, white});
  box(s, {1.5f, 0, 0}, {12, 2.5f, 3}, white);
  box(s, {0, 0, 4.5f}, {7.5f, 2.5f, 12}, white);
  box(s, {9, 0, 3}, {12, 2.5f, 10.5f}, white);
  const Rooms r(s.scene, 0.5);
  const auto part = [](const Cluster& c) {
    if (c.hi_m.x < 1.51f && c.hi_m.z < 3.01f) return 0;
    if (c.lo_m.x > 1.51f && c.hi_m.x < 7.49f && c.lo_m.z > 2.99f && c.hi_m.z < 4.51f) return 1;
    return c.lo_m.x > 8.99f && c.lo_m.z > 10.49f ? 2 : -1;
  };
  EXPECT_EQ(r.shareApart(0, 1, part), 0.0);
  EXPECT_EQ(r.shareApart(0, 2, part), 1.0);
}

TEST(Cells, ALevelWithoutRoomsHasNone) {
  test::SceneBuilder s(16);
  const auto white = s.material(Rgb(0.5f));
  s.quad({-10, 0, -10}, {0, 0, 20}, {20, 0, 0}, white);
  s.quad({0, 0, 0}, {0, 3, 0}, {4, 0, 0}, white);
  const Rooms r(s.scene);
  EXPECT_FALSE(r.partition.hasRooms());
  EXPECT_EQ(r.castBetweenNodesApart(1, 1000, 1).pairs, 0u);
}

TEST(Cells, NoRayPassesBetweenNodesThatAreApart) {
  // With those of the property below 1e6 rays and more.
  std::uint64_t cast = 0;
  const auto check = [&](const Scene& s, const char* name, double size = 0.6) {
    const Rooms r(s, size);
    const Rooms::Rays rays = r.castBetweenNodesApart(200'000, 400'000, 3);
    EXPECT_EQ(rays.through, 0u) << name << ", of " << rays.cast;
    EXPECT_GT(rays.pairs, 1000u) << name;
    cast += rays.cast;
  };
  check(twoRooms({}), "closed");
  check(twoRooms({.width = 0.9f}), "doorway");
  check(twoRooms({.gap = 0.001f}), "gap");
  check(chain(16), "chain");
  check(placed(chain(8), 1.0, {}, 0.3), "chain, turned");
  check(placed(chain(8), 1e-3, {}, 0.3), "chain, small", 0.6e-3);
  check(placed(chain(8), 1e3, {}, 0.3), "chain, large", 0.6e3);
  EXPECT_GT(cast, 800'000u);
}

/// A house of random rooms: walls that cross it or end at others, each with or without doors, tables, some turned.
Scene house(std::uint32_t seed) {
  std::mt19937 random(seed);
  const auto number = [&](float a, float b) { return a + (b - a) * float(random() % 1024u) / 1024.0f; };
  test::SceneBuilder s(32);
  const auto white = s.material(Rgb(0.7f));
  const glm::vec3 size(number(6, 20), number(2, 4), number(6, 20));
  s.room({0, 0, 0}, size, {white, white, white, white, white, white}, 1 + int(random() % 4u));
  struct Part {
    glm::vec2 lo, hi;
  };
  std::vector<Part> parts{{{0, 0}, {size.x, size.z}}};
  for (std::size_t k = 0; k < parts.size() && parts.size() < 10; ++k) {
    const Part p = parts[k];
    const int axis = p.hi.x - p.lo.x > p.hi.y - p.lo.y ? 0 : 1;
    if (p.hi[axis] - p.lo[axis] < 3.0f) continue;
    const float at = number(p.lo[axis] + 1.0f, p.hi[axis] - 1.0f), thick = random() % 3u == 0 ? 0.0f : 0.125f;
    // Doors: none, one or two, to the floor.
    std::vector<float> ends{p.lo[1 - axis], p.hi[1 - axis]};
    const float length = ends[1] - ends[0];
    for (unsigned d = random() % 3u; d > 0; --d) {
      const float door = number(ends[ends.size() - 2], ends.back() - 0.3f * length * 0.5f), width = number(0.1f, 0.9f);
      if (door + width < ends.back()) ends.insert(ends.end() - 1, {door, door + width});
    }
    const float top = random() % 8u == 0 ? size.y - number(0.01f, 0.5f) : size.y;
    for (std::size_t e = 0; e + 1 < ends.size(); e += 2) {
      glm::vec3 lo(0.0f), hi(0.0f, top, 0.0f);
      lo[2 * axis] = at, hi[2 * axis] = at + thick;
      lo[2 - 2 * axis] = ends[e], hi[2 - 2 * axis] = ends[e + 1];
      if (thick > 0.0f) {
        box(s, lo, hi, white, 1 + int(random() % 3u));
      } else {  // a sheet, one side of which is dark
        glm::vec3 along(0.0f);
        along[2 - 2 * axis] = ends[e + 1] - ends[e];
        s.quad(lo, along, {0, top, 0}, white);
      }
    }
    Part a = p, b = p;
    a.hi[axis] = at, b.lo[axis] = at + thick;
    parts.push_back(a), parts.push_back(b);
  }
  for (unsigned t = random() % 4u; t > 0; --t) {
    const glm::vec3 lo(number(0.5f, size.x - 2), number(0, 1), number(0.5f, size.z - 2));
    box(s, lo, lo + glm::vec3(number(0.2f, 1), 0.1f, number(0.2f, 1)), white);
  }
  return placed(s.scene, std::pow(10.0, double(number(-3, 3))), {}, random() % 2u == 0 ? 0.0 : double(number(0.0f, 3.0f)));
}

RC_GTEST_PROP(Cells, NoRayPassesBetweenNodesApartOfAnyHouse, ()) {
  const Scene scene = house(*rc::gen::arbitrary<std::uint32_t>());
  const Rooms r(scene, 0.03 * double(scene.extent_m));
  const Rooms::Rays rays = r.castBetweenNodesApart(20'000, 20'000, 5);
  RC_CLASSIFY(rays.pairs > 0);
  RC_ASSERT(rays.open == 0u);
}

TEST(Cells, TwoClosedRoomsSaveRaysAndChangeNoLight) {
  const Scene scene = twoRooms({});
  const lmc::Run run;
  const Tracer tracer(scene);
  const DirectLight direct(scene, tracer, true);
  PatchMesh mesh = makePatches(scene, {.size_m = 0.6}, run);
  exposePatches(mesh, scene, tracer, run);
  const PatchLight light = lightPatches(scene, tracer, mesh, direct, {}, run);
  HierarchicalOptions with, without;
  without.partition.on[std::size_t(Rule::Cells)] = false;
  const HierarchicalSolution a = solveHierarchical(scene, tracer, mesh, light, with, run),
                             b = solveHierarchical(scene, tracer, mesh, light, without, run);
  const RuleCount& c = a.stats.rules[std::size_t(Rule::Cells)];
  EXPECT_TRUE(c.on);
  EXPECT_GT(c.asked, 0u);
  EXPECT_GT(c.settled, 0u);
  EXPECT_GT(c.raysSaved, 0u);
  EXPECT_EQ(b.stats.rules[std::size_t(Rule::Cells)].asked, 0u);
  EXPECT_LT(a.stats.rays, b.stats.rays);
  double off = 0.0, mean = 0.0;
  for (std::size_t i = 0; i < mesh.patches.size(); ++i) {
    const double d = double(a.fine.illuminance[i].r) - double(b.fine.illuminance[i].r);
    off += mesh.patches[i].area_m2 * d * d;
    mean += mesh.patches[i].area_m2 * double(b.fine.illuminance[i].r) * double(b.fine.illuminance[i].r);
  }
  // Two solutions of the goal's 2 %, half of it for the links of each.
  EXPECT_LT(std::sqrt(off / mean), 0.02);
}

}  // namespace
}  // namespace lmc
