/// Map UVs of surfaces that are easy, hard and hopeless: what comes out is checked in whole numbers, by code that shares nothing with the
/// code that makes it.
#include "libscene/unwrap.h"

#include <gtest/gtest.h>

#include <functional>
#include <random>
#include <set>

#include "libscene/charts.h"
#include "libscene/constants.h"
#include "libscene/parallel.h"
#include "libscene/scene_builder.h"
#include "libscene/tracer.h"

namespace lmc {
namespace {

/// A surface (u, v) -> place, as a grid with smooth normals; without map UVs.
std::uint32_t addSheet(Scene& scene, int nu, int nv, const std::function<glm::dvec3(double, double)>& f) {
  Object o;
  o.name = o.path = "/sheet" + std::to_string(scene.objects.size());
  o.node = o.mesh = std::uint32_t(scene.objects.size());
  o.firstTriangle = std::uint32_t(scene.triangles.size());
  o.firstVertex = std::uint32_t(scene.positions_m.size());
  o.material = 0;
  for (int j = 0; j <= nv; ++j)
    for (int i = 0; i <= nu; ++i) {
      const double u = double(i) / nu, v = double(j) / nv, d = 1e-4;
      const glm::dvec3 n = glm::cross(f(u + d, v) - f(u - d, v), f(u, v + d) - f(u, v - d));
      scene.positions_m.push_back(glm::vec3(f(u, v)));
      scene.normals.push_back(glm::vec3(glm::length(n) > 0.0 ? glm::normalize(n) : glm::dvec3(0, 1, 0)));
      scene.uv0.push_back({float(u), float(v)});
      scene.mapUv.push_back({0.0f, 0.0f});
      scene.sourceVertex.push_back(std::uint32_t(scene.sourceVertex.size()) - o.firstVertex);
    }
  const auto at = [&](int i, int j) { return o.firstVertex + std::uint32_t(j * (nu + 1) + i); };
  for (int j = 0; j < nv; ++j)
    for (int i = 0; i < nu; ++i)
      for (const glm::uvec3 t :
           {glm::uvec3(at(i, j), at(i + 1, j), at(i + 1, j + 1)), glm::uvec3(at(i, j), at(i + 1, j + 1), at(i, j + 1))}) {
        const glm::dvec3 a(scene.positions_m[t.x]), b(scene.positions_m[t.y]), c(scene.positions_m[t.z]);
        if (glm::length(glm::cross(b - a, c - a)) > 0.0) scene.triangles.push_back(t);
      }
  o.triangleCount = std::uint32_t(scene.triangles.size()) - o.firstTriangle;
  o.vertexCount = std::uint32_t(scene.positions_m.size()) - o.firstVertex;
  scene.triangleObject.resize(scene.triangles.size(), std::uint32_t(scene.objects.size()));
  scene.objects.push_back(o);
  if (scene.materials.empty()) scene.materials.emplace_back();
  for (const glm::vec3& p : scene.positions_m)
    for (int k = 0; k < 3; ++k) scene.extent_m = std::max(scene.extent_m, std::abs(p[k]));
  return std::uint32_t(scene.objects.size() - 1);
}

glm::dvec3 ball(double u, double v) {
  const double a = 2 * kPi * u, b = kPi * v;
  return {std::sin(b) * std::cos(a), -std::cos(b), -std::sin(b) * std::sin(a)};
}
glm::dvec3 tube(double u, double v) { return {std::cos(2 * kPi * u), 3.0 * v, -std::sin(2 * kPi * u)}; }
/// A ramp of three turns about an axis: every normal points up, and it lies over itself.
glm::dvec3 ramp(double u, double v) { return {(1.0 + v) * std::cos(6 * kPi * u), 2.0 * u, -(1.0 + v) * std::sin(6 * kPi * u)}; }

using Place = glm::i64vec2;

std::int64_t turn(Place a, Place b, Place c) { return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x); }

struct Found {
  std::uint64_t flipped = 0, overlapping = 0, flat = 0;
  double efficiency = 0.0;
};

/// All pairs, in whole numbers of 2^-23.
Found check(const Scene& scene) {
  Found out;
  struct Item {
    std::array<Place, 3> p;
    std::uint32_t map;
  };
  std::vector<Item> items;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    Item item{{}, scene.objectOf(t).map};
    for (int k = 0; k < 3; ++k) {
      const glm::dvec2 g = glm::dvec2(scene.mapUv[scene.triangles[t][k]]) * 0x1p23;
      EXPECT_EQ(g, glm::floor(g));
      EXPECT_TRUE(g.x >= 0 && g.y >= 0 && g.x <= 0x1p23 && g.y <= 0x1p23);
      item.p[std::size_t(k)] = Place(g);
    }
    if (scene.objectOf(t).mirrored) std::swap(item.p[1], item.p[2]);  // as the file has them
    const std::int64_t area = turn(item.p[0], item.p[1], item.p[2]);
    out.flipped += area < 0;
    out.flat += area == 0;
    out.efficiency += 0.5 * double(area) * 0x1p-46;
    if (area > 0) items.push_back(item);
  }
  const auto apart = [](const Item& a, const Item& b) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Place p = a.p[k], q = a.p[(k + 1) % 3];
      if (turn(p, q, b.p[0]) <= 0 && turn(p, q, b.p[1]) <= 0 && turn(p, q, b.p[2]) <= 0) return true;
    }
    return false;
  };
  for (std::size_t i = 0; i < items.size(); ++i)
    for (std::size_t j = i + 1; j < items.size(); ++j)
      out.overlapping += items[i].map == items[j].map && !apart(items[i], items[j]) && !apart(items[j], items[i]);
  return out;
}

UvLayout made(Scene& scene, UvOptions options = {}) {
  UvLayout out;
  const lmc::Run run;
  withThreads(run, [&] { out = layOut(scene, options, run); });
  return out;
}

void expectSound(const Scene& scene) {
  const Found f = check(scene);
  EXPECT_EQ(f.flipped, 0u);
  EXPECT_EQ(f.overlapping, 0u);
}

TEST(Unwrap, ATubeLiesFlatWithoutStretch) {
  Scene scene;
  addSheet(scene, 48, 12, tube);
  const UvLayout layout = made(scene);
  expectSound(scene);
  EXPECT_LE(layout.charts, 3u);
  // Rounding to whole texels changes a side by less than 1/20 here: L2 of s and 1/s is 1 + (s - 1)^2.
  EXPECT_NEAR(layout.objects[0].stretch, 1.0, 0.003);
}

TEST(Unwrap, ABallGetsFewChartsOfLittleStretch) {
  Scene scene;
  addSheet(scene, 64, 32, ball);
  const UvLayout layout = made(scene);
  expectSound(scene);
  EXPECT_LE(layout.charts, 16u);
  EXPECT_LE(layout.meanStretch, 1.05);
}

TEST(Unwrap, ARampThatLiesOverItselfIsTakenApart) {
  Scene scene;
  addSheet(scene, 120, 4, ramp);
  const UvLayout layout = made(scene);
  expectSound(scene);
  EXPECT_GE(layout.charts, 3u);
}

TEST(Unwrap, NeedlesAndCrumbsKeepTheirSide) {
  Scene scene;
  addSheet(scene, 40, 4, [](double u, double v) { return glm::dvec3(100.0 * u, 1e-5 * v, std::sin(9.0 * u)); });  // 1 : 1e6
  addSheet(scene, 30, 30, [](double u, double v) { return glm::dvec3(std::pow(u, 12.0), std::pow(v, 12.0), u * v); });
  addSheet(scene, 8, 8, [](double u, double v) { return 1e-4 * glm::dvec3(u, v, u * u); });
  made(scene);
  expectSound(scene);
}

/// Triangles that share edges in threes, lie on each other, or hang together by corners alone.
TEST(Unwrap, ATangleEnds) {
  std::mt19937 random(3);
  Scene scene;
  const std::uint32_t sheet = addSheet(scene, 8, 8, [](double u, double v) { return glm::dvec3(u, 0.0, -v); });
  const Object o = scene.objects[sheet];
  scene.triangles.clear();
  for (int i = 0; i < 300; ++i) {
    glm::uvec3 t;
    do t = {random() % 81, random() % 81, random() % 81};
    while (t.x == t.y || t.y == t.z || t.z == t.x ||
           glm::length(glm::cross(glm::dvec3(scene.positions_m[t.y] - scene.positions_m[t.x]),
                                  glm::dvec3(scene.positions_m[t.z] - scene.positions_m[t.x]))) == 0.0);
    scene.triangles.push_back(t);
  }
  for (glm::vec3& p : scene.positions_m) p.y = float(random() % 1000) / 1000.0f;
  scene.objects[sheet].triangleCount = 300;
  scene.triangleObject.assign(300, sheet);
  made(scene, {.mapSize = 512});
  expectSound(scene);
}

TEST(Unwrap, DensityIsWhatWasAskedFor) {
  SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  for (int i = 0; i < 4; ++i) b.quad({5.0 * i, 0, 0}, {2.0f, 0, 0}, {0, 0, -1.5f}, m);
  b.scene.objects[2].texelsPerMetre = 64.0;
  const UvLayout layout = made(b.scene, {.mode = UvMode::New, .texelsPerMetre = 32.0});
  for (const int i : {0, 1, 3}) EXPECT_NEAR(layout.objects[std::size_t(i)].texelsPerMetre, 32.0, 1e-3);  // 64 x 48 texels, whole
  EXPECT_NEAR(layout.objects[2].texelsPerMetre, 64.0, 1e-3);
  expectSound(b.scene);
}

TEST(Unwrap, SoundUvsKeepTheirBytesBesideNewOnes) {
  SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  for (int i = 0; i < 6; ++i) b.quad({5.0 * i, 0, 0}, {2.0f, 0, 0}, {0, 0, -1.0f}, m);
  Scene& scene = b.scene;
  scene.objects[1].inMap = false;                                                                   // has none
  for (int k = 0; k < 4; ++k) scene.mapUv[std::size_t(12 + k)] = scene.mapUv[std::size_t(16 + k)];  // objects 3 and 4 lie on each other
  const std::vector<glm::vec2> before = scene.mapUv;
  const UvLayout layout = made(scene, {.mapSize = 128});
  EXPECT_EQ(layout.side, 128);
  for (const std::size_t i : {0u, 2u, 5u}) {
    EXPECT_EQ(layout.objects[i].fate, ObjectUv::Fate::Kept);
    for (std::size_t k = 0; k < 4; ++k) EXPECT_EQ(scene.mapUv[scene.objects[i].firstVertex + k], before[4 * i + k]);
  }
  EXPECT_EQ(layout.objects[1].fate, ObjectUv::Fate::Made);
  EXPECT_EQ(layout.objects[3].fate, ObjectUv::Fate::Repaired);
  EXPECT_EQ(layout.objects[4].fate, ObjectUv::Fate::Repaired);
  EXPECT_EQ(uvFaults(scene, 128).size(), 0u);
  EXPECT_EQ(examineUvs(scene, {.mapSize = 128}).faults.size(), 0u);
}

TEST(Unwrap, KeepRefusesWhatItWouldHaveToChange) {
  SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.quad({0, 0, 0}, {2.0f, 0, 0}, {0, 0, -1.0f}, m);
  b.scene.objects[0].inMap = false;
  try {
    made(b.scene, {.mode = UvMode::Keep});
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.kind, Exit::Unsupported);
    EXPECT_EQ(e.code, "LMC_UV_MISSING");
  }
}

TEST(Unwrap, ChartsNearerThanALookUpAreMovedApart) {
  SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  for (int i = 0; i < 2; ++i) b.quad({5.0 * i, 0, 0}, {2.0f, 0, 0}, {0, 0, -1.0f}, m);
  for (std::size_t v = 0; v < 8; ++v) {
    const glm::vec2 inside = b.scene.uv0[v];  // left and right half, one texel of 64 between them
    b.scene.mapUv[v] = glm::vec2((v < 4 ? 0.0f : 32.0f / 64.0f) + inside.x * 31.0f / 64.0f, inside.y);
  }
  Scene wide = b.scene;
  EXPECT_TRUE(made(b.scene, {.mapSize = 64}).changed());
  EXPECT_FALSE(made(wide, {.mapSize = 256}).changed());  // four texels there
}

/// The same mesh three times: as it is, half as large and turned, mirrored. All are laid out alike, each in its own place.
TEST(Unwrap, EveryUseOfAMeshGetsItsOwnPlace) {
  Scene scene;
  addSheet(scene, 24, 12, ball);
  const Object first = scene.objects[0];
  const auto use = [&](auto place, auto turned, bool mirrored) {
    Object o = first;
    o.path = o.name = "/use" + std::to_string(scene.objects.size());
    o.node = std::uint32_t(scene.objects.size());
    o.mirrored = mirrored;
    o.firstTriangle = std::uint32_t(scene.triangles.size());
    o.firstVertex = std::uint32_t(scene.positions_m.size());
    for (std::uint32_t v = 0; v < first.vertexCount; ++v) {
      scene.positions_m.push_back(place(scene.positions_m[v]));
      scene.normals.push_back(turned(scene.normals[v]));
      scene.uv0.push_back(scene.uv0[v]);
      scene.mapUv.push_back({0.0f, 0.0f});
      scene.sourceVertex.push_back(v);
    }
    for (std::uint32_t t = 0; t < first.triangleCount; ++t) {
      scene.triangles.push_back(scene.triangles[t] + o.firstVertex);
      if (mirrored) std::swap(scene.triangles.back().y, scene.triangles.back().z);
      scene.triangleObject.push_back(std::uint32_t(scene.objects.size()));
    }
    scene.objects.push_back(o);
  };
  use([](glm::vec3 p) { return glm::vec3(0.5f * p.z + 4.0f, 0.5f * p.x, 0.5f * p.y); },
      [](glm::vec3 n) { return glm::vec3(n.z, n.x, n.y); }, false);
  use([](glm::vec3 p) { return glm::vec3(-p.x, p.y, p.z - 4.0f); }, [](glm::vec3 n) { return glm::vec3(-n.x, n.y, n.z); }, true);
  const UvLayout layout = made(scene, {.mapSize = 512});
  expectSound(scene);
  EXPECT_EQ(layout.objects[0].charts, layout.objects[1].charts);
  EXPECT_EQ(layout.objects[0].charts, layout.objects[2].charts);
  EXPECT_NEAR(layout.objects[0].stretch, layout.objects[1].stretch, 0.03);
}

TEST(Unwrap, SeveralMapsAreFilledAndNoMoreThanAllowed) {
  SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  for (int i = 0; i < 9; ++i) b.quad({5.0 * i, 0, 0}, {3.0f, 0, 0}, {0, 0, -3.0f}, m);
  Scene again = b.scene;
  const UvLayout layout = made(b.scene, {.mode = UvMode::New, .mapSize = 64, .texelsPerMetre = 16.0});  // 48 x 48 texels each: one a map
  EXPECT_EQ(layout.maps, 9);
  expectSound(b.scene);
  std::set<std::uint32_t> maps;
  for (const Object& o : b.scene.objects) maps.insert(o.map);
  EXPECT_EQ(maps.size(), 9u);
  try {
    made(again, {.mode = UvMode::New, .mapSize = 64, .texelsPerMetre = 16.0, .maxMaps = 8});
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.kind, Exit::Limit);
  }
}

TEST(Unwrap, TheSameForAnyNumberOfThreads) {
  std::vector<glm::vec2> first;
  for (const int threads : {1, 2, 5}) {
    Scene scene;
    addSheet(scene, 40, 20, ball);
    addSheet(scene, 60, 8, ramp);
    lmc::Run run;
    run.threads = threads;
    withThreads(run, [&] { layOut(scene, {}, run); });
    if (first.empty())
      first = scene.mapUv;
    else
      EXPECT_EQ(scene.mapUv, first) << threads;
  }
}

TEST(Unwrap, AFarAndLargeLevelIsLaidOutAsANearOne) {
  Scene near, far;
  addSheet(near, 32, 16, ball);
  addSheet(far, 32, 16, [](double u, double v) { return 1024.0 * ball(u, v) + glm::dvec3(8192.0, 0.0, 4096.0); });
  const UvLayout a = made(near, {.mapSize = 256}), b = made(far, {.mapSize = 256});
  expectSound(far);
  // Places there are known to a thousandth of a metre: a triangle of 300 m moves its normal by less than a thousandth of a degree.
  EXPECT_EQ(a.charts, b.charts);
  EXPECT_LE(b.meanStretch, 1.05);
}

}  // namespace
}  // namespace lmc
