/// The light tree asks fewer lights and loses none: sums over choices against the plain sum over all lights.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>
#include <set>

#include "libradiosity/direct.h"
#include "libradiosity/form_factor.h"
#include "libradiosity/light_map.h"
#include "libradiosity/light_tree.h"
#include "libradiosity/lights.h"
#include "libscene/constants.h"
#include "tests/support/bake_scene.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

class Random {
 public:
  explicit Random(std::uint32_t seed) : engine_(seed) {}
  double in(double lo, double hi) { return std::uniform_real_distribution<double>(lo, hi)(engine_); }
  glm::dvec3 inBox(const glm::dvec3& lo, const glm::dvec3& hi) { return {in(lo.x, hi.x), in(lo.y, hi.y), in(lo.z, hi.z)}; }
  glm::dvec3 direction() {
    const double z = in(-1.0, 1.0), phi = in(0.0, 2.0 * kPi), r = std::sqrt(1.0 - z * z);
    return {r * std::cos(phi), r * std::sin(phi), z};
  }

 private:
  std::mt19937 engine_;
};

constexpr glm::dvec3 kLo{-20.0, 0.0, -10.0}, kHi{20.0, 6.0, 10.0};

/// Points, spots and ranged lamps in turn, and emissive triangles, all over a hall.
Scene lit(std::uint32_t seed, int lamps, int panels) {
  Random random(seed);
  test::SceneBuilder s;
  const auto shine = s.material(Rgb(0.0f), Rgb(3.0f, 2.0f, 1.0f));
  for (int k = 0; k < panels; ++k) {
    const glm::dvec3 n = random.direction();
    const glm::dvec3 u = glm::normalize(glm::cross(n, random.direction())), v = glm::cross(n, u);
    s.quad(glm::vec3(random.inBox(kLo, kHi)), glm::vec3(random.in(0.1, 1.0) * u), glm::vec3(random.in(0.1, 1.0) * v), shine);
  }
  for (int k = 0; k < lamps; ++k) {
    Light l;
    l.path = "/lamp" + std::to_string(k);
    l.position_m = random.inBox(kLo, kHi);
    l.direction = random.direction();
    l.intensity = Rgb(std::exp(random.in(-3.0, 3.0)));
    if (k % 3 == 1) {
      l.kind = Light::Kind::Spot;
      const double outer = random.in(0.1, 1.5);
      l.cosOuter = std::cos(outer);
      l.cosInner = std::cos(random.in(0.0, outer));
    }
    if (k % 3 == 2 || k % 7 == 0) l.range_m = random.in(1.0, 15.0);
    s.scene.lights.push_back(l);
  }
  return s.scene;
}

struct Hall {
  Hall(std::uint32_t seed, int lamps, int panels)
      : scene(lit(seed, lamps, panels)), emitters(findEmitters(scene, 2048)), tree(scene, emitters) {}
  /// What a light gives to a place when nothing is in between [lx].
  double given(std::uint32_t light, const SurfacePoint& p) const {
    if (light < tree.punctualCount()) return incoming(scene.lights[light], p.position_m, p.normal).illuminance.x;
    const Emitter& e = emitters.whole[light - tree.punctualCount()];
    return kPi * double(e.radiance.r) * elementToPolygon(p.position_m, p.normal, e.corner_m);
  }
  std::uint32_t count() const { return tree.punctualCount() + std::uint32_t(emitters.whole.size()); }
  Scene scene;
  Emitters emitters;
  LightTree tree;
};

SurfacePoint place(const glm::dvec3& at, const glm::dvec3& normal) {
  SurfacePoint p;
  p.position_m = at;
  p.normal = p.geometricNormal = normal;
  return p;
}

Receivers someReceivers(Random& random, double largest_m) {
  Receivers r;
  r.centre_m = random.inBox(kLo, kHi);
  r.radius_m = random.in(0.0, largest_m);
  r.normal = random.direction();
  r.bend_rad = random.in(0.0, 0.5);
  return r;
}

SurfacePoint placeOf(const Receivers& r, Random& random) {
  const glm::dvec3 at = r.centre_m + r.radius_m * std::cbrt(random.in(0.0, 1.0)) * random.direction();
  const glm::dvec3 off = glm::cross(r.normal, random.direction());
  const double bend = r.bend_rad * random.in(0.0, 1.0);
  return place(at, glm::normalize(std::cos(bend) * r.normal + std::sin(bend) * glm::normalize(off)));
}

TEST(LightTree, ChoicesAreUnbiased) {
  // Sum of the lights asked by themselves, plus the mean over choices of (what the light gives)/(share of the choice), is the sum over all.
  Random random(3);
  std::size_t places = 0;
  double worst = 0.0, chosen = 0.0;
  for (const std::uint32_t seed : {1u, 2u, 3u}) {
    const Hall hall(seed, 300, 60);
    for (int k = 0; k < 25; ++k) {
      const Receivers r = someReceivers(random, 1.0);
      const LightCut cut = hall.tree.cutFor(r);
      const LightTree::Groups groups(hall.tree, cut, r);
      const SurfacePoint p = placeOf(r, random);
      double exact = 0.0, asked = 0.0, sum = 0.0, squares = 0.0;
      for (std::uint32_t l = 0; l < hall.count(); ++l) exact += hall.given(l, p);
      for (const std::uint32_t l : cut.punctual) asked += hall.given(l, p);
      for (const std::uint32_t e : cut.emitters) asked += hall.given(hall.tree.punctualCount() + e, p);
      constexpr int kDraws = 20000;
      std::size_t group = 0;
      for (int d = 0; d < kDraws; ++d) {
        double u = random.in(0.0, 1.0);
        const LightTree::Choice c = groups.choose(p, u, group);
        ASSERT_GE(u, 0.0);
        ASSERT_LT(u, 1.0);
        const double x = c.share > 0.0 ? hall.given(c.light, p) / c.share : 0.0;
        sum += x;
        squares += x * x;
      }
      const double mean = sum / kDraws, error = std::sqrt(std::max(0.0, squares / kDraws - mean * mean) / kDraws);
      EXPECT_NEAR(asked + mean, exact, 4.0 * error + 1e-9 * exact) << "hall " << seed << " place " << k;
      if (error > 0.0) worst = std::max(worst, std::abs(asked + mean - exact) / error);
      chosen += exact > 0.0 ? mean / exact : 0.0;
      ++places;
    }
  }
  EXPECT_GT(chosen / double(places), 0.005) << "groups must carry a part of the light, or nothing was tested";
  std::printf("figure: light tree, %zu places, off by at most %.2f standard errors, %.2g of the light by choices\n", places, worst,
              chosen / double(places));
}

TEST(LightTree, NoLightThatGivesSomethingIsDropped) {
  // Few enough lights that a cut names each of them: brute force over places.
  Random random(5);
  std::size_t giving = 0, dropped = 0;
  for (std::uint32_t seed = 1; seed <= 60; ++seed) {
    const Hall hall(seed, 16, 4);
    for (int k = 0; k < 20; ++k) {
      const Receivers r = someReceivers(random, 4.0);
      const LightCut cut = hall.tree.cutFor(r);
      ASSERT_TRUE(cut.groups.empty()) << "few lights are all asked by themselves";
      std::set<std::uint32_t> asked(cut.punctual.begin(), cut.punctual.end());
      for (const std::uint32_t e : cut.emitters) asked.insert(hall.tree.punctualCount() + e);
      dropped += hall.count() - asked.size();
      for (int i = 0; i < 30; ++i) {
        const SurfacePoint p = placeOf(r, random);
        for (std::uint32_t l = 0; l < hall.count(); ++l) {
          if (!(hall.given(l, p) > 0.0)) continue;
          ++giving;
          ASSERT_TRUE(asked.contains(l)) << "hall " << seed << " light " << l << " gives " << hall.given(l, p);
        }
      }
    }
  }
  EXPECT_GT(giving, 100000u);
  EXPECT_GT(dropped, 1000u) << "cuts must leave something out, or nothing was tested";
}

TEST(LightTree, DirectionalAndClassicLightsAreAlwaysAsked) {
  Scene scene = lit(1, 200, 0);
  scene.lights[17].kind = Light::Kind::Directional;
  scene.lights[23].classic.emplace();
  const LightTree tree(scene, findEmitters(scene, 2048));
  Random random(9);
  for (int k = 0; k < 50; ++k) {
    const LightCut cut = tree.cutFor(someReceivers(random, 1.0));
    EXPECT_TRUE(std::ranges::binary_search(cut.punctual, 17u));
    EXPECT_TRUE(std::ranges::binary_search(cut.punctual, 23u));
  }
}

TEST(LightTree, CutsAreBoundedAndNameNoLightTwice) {
  const Hall hall(4, 3000, 300);
  Random random(11);
  std::size_t largest = 0;
  for (int k = 0; k < 200; ++k) {
    const LightCut cut = hall.tree.cutFor(someReceivers(random, 3.0));
    largest = std::max(largest, cut.punctual.size() + cut.emitters.size() + cut.groups.size());
    EXPECT_EQ(std::set(cut.punctual.begin(), cut.punctual.end()).size(), cut.punctual.size());
    EXPECT_EQ(std::set(cut.emitters.begin(), cut.emitters.end()).size(), cut.emitters.size());
    EXPECT_EQ(std::set(cut.groups.begin(), cut.groups.end()).size(), cut.groups.size());
  }
  EXPECT_LE(largest, LightTree::kMostNodes);
  EXPECT_GT(largest, 8u);
}

TEST(LightTree, NoDrawCountsMoreThanTheMostThatItsGroupsCanGive) {
  // contribution/share of every choice, against the sum of bounds over the share of draws that goes by them. Places and emitters may touch.
  // Bounds add up over halves but for the cosines, which are those of spheres: a node's sphere does not hold those of its halves, and a
  // group is parted in a few steps only. Twice covers that.
  constexpr double kSlack = 2.0;
  Random random(17);
  double worst = 0.0;
  std::size_t draws = 0;
  for (const std::uint32_t seed : {6u, 7u, 8u, 9u}) {
    const Hall hall(seed, seed % 2 ? 200 : 0, 2000);
    for (int k = 0; k < 60; ++k) {
      Receivers block = someReceivers(random, 1.0);
      if (k % 3 == 0) block.centre_m = hall.emitters.whole[std::size_t(k) * 7].corner_m[0];
      const LightCut cut = hall.tree.cutFor(block);
      // A few texels of the block.
      Receivers texels = block;
      texels.radius_m = block.radius_m * random.in(0.0, 0.2);
      texels.centre_m += (block.radius_m - texels.radius_m) * random.in(0.0, 1.0) * random.direction();
      const LightTree::Groups groups(hall.tree, cut, texels);
      for (int i = 0; i < 40; ++i) {
        const SurfacePoint p = placeOf(texels, random);
        std::size_t group = 0;
        for (int d = 0; d < 100; ++d) {
          double u = (double(d) + random.in(0.0, 1.0)) / 100.0;
          const LightTree::Choice c = groups.choose(p, u, group);
          if (!(c.share > 0.0)) continue;
          worst = std::max(worst, hall.given(c.light, p) / c.share / groups.mostWeight());
          ++draws;
        }
      }
    }
  }
  std::printf("figure: heaviest of %zu draws counts %.2g of the bound\n", draws, worst);
  EXPECT_GT(draws, 100000u);
  EXPECT_LE(worst, kSlack);
}

/// A hall with columns and 2 x nx x nz emissive triangles below the ceiling: the same light for all numbers.
Scene panelled(int nx, int nz) {
  test::SceneBuilder s;
  const auto grey = s.material(Rgb(0.5f)), shine = s.material(Rgb(0.0f), Rgb(2000.0f));
  s.room({0, 0, 0}, {40, 6, 20}, {grey, grey, grey, grey, grey, grey});
  for (int k = 0; k < 8; ++k) {
    const float x = 4.6f + 10.0f * float(k % 4), z = k < 4 ? 5.6f : 13.6f;
    s.quad({x, 0, z}, {0, 6, 0}, {0.8f, 0, 0}, grey);
    s.quad({x, 0, z + 0.8f}, {0.8f, 0, 0}, {0, 6, 0}, grey);
    s.quad({x, 0, z}, {0, 0, 0.8f}, {0, 6, 0}, grey);
    s.quad({x + 0.8f, 0, z}, {0, 6, 0}, {0, 0, 0.8f}, grey);
    for (int side = 1; side <= 4; ++side) s.scene.objects[s.scene.objects.size() - std::size_t(side)].receive = false;
  }
  const float side = std::sqrt(8.0f / float(nx * nz));
  for (int i = 0; i < nx; ++i)
    for (int j = 0; j < nz; ++j) {
      const float x = (float(i) + 0.5f) * 40.0f / float(nx), z = (float(j) + 0.5f) * 20.0f / float(nz);
      s.quad({x - side / 2, 5.6f, z - side / 2}, {side, 0, 0}, {0, 0, side}, shine);
      s.scene.objects.back().receive = false;
    }
  return s.scene;
}

TEST(LightTree, ThousandsOfPanelsTakeAtMostThreeTimesTheRaysOfTenWithinTheGoal) {
  // Three: what the hall of 10,000 emissive triangles may cost against that of 20, as a time; rays are what a time is made of.
  const auto baked = [](int nx, int nz) {
    const Scene scene = panelled(nx, nz);
    const lmc::Run run;
    const Charts charts = findCharts(scene, 512, run);
    const TexelMap texels(scene, charts, 512);
    const Tracer tracer(scene);
    const DirectLight direct(scene, tracer, true);
    LightMap map = startMap(scene, texels, run);
    bakeDirect(map, scene, texels, direct, {.goal = 0.02}, run);
    return std::pair(double(tracer.rays(Purpose::Emitter)), ledger(map, scene, {}).noise);
  };
  const auto [fewRays, fewNoise] = baked(5, 2);
  const auto [manyRays, manyNoise] = baked(100, 50);
  std::printf("figure: 20 triangles %.3g rays, noise %.2f %%; 10000 triangles %.3g rays, noise %.2f %%\n", fewRays, 100.0 * fewNoise,
              manyRays, 100.0 * manyNoise);
  EXPECT_LT(manyRays, 3.0 * fewRays);
  EXPECT_LT(manyNoise, 0.02) << "the goal";
}

TEST(LightTree, HallOf200LampsIsBakedWithinItsStatedError) {
  test::SceneBuilder s;
  const auto grey = s.material(Rgb(0.5f));
  s.room({0, 0, 0}, {40, 6, 20}, {grey, grey, grey, grey, grey, grey});
  for (int k = 0; k < 4; ++k) s.quad({6.0f + 8.0f * float(k), 0, 6}, {0, 0, 8}, {0, 4, 0}, grey);  // screens
  Random random(13);
  for (int k = 0; k < 200; ++k) {
    Light l;
    l.path = "/lamp" + std::to_string(k);
    l.position_m = {1.0 + 2.0 * (k % 20), random.in(3.0, 5.5), 1.0 + 2.0 * (k / 20)};
    l.intensity = Rgb(float(random.in(1.0, 20.0)), float(random.in(1.0, 20.0)), 5.0f);
    if (k % 2) l.range_m = random.in(4.0, 12.0);
    s.scene.lights.push_back(l);
  }
  const test::Baked b = test::bakeScene(s.scene, {.side = 96, .bounce = false});
  // Every lamp asked at 128 places of every 13th texel: error about 128^-0.75 of a part's contrast, well below what is stated.
  const lmc::Run run;
  const Charts charts = findCharts(s.scene, 96, run);
  const TexelMap texels(s.scene, charts, 96);
  const Tracer tracer(s.scene);
  const DirectLight direct(s.scene, tracer, true);
  double squares = 0.0, bias = 0.0, mean = 0.0, n = 0.0;
  for (std::size_t t = 0; t < texels.tileCount(); ++t) {
    const TexelTile tile = texels.texels(t);
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        const std::size_t i = b.map.index(tile, x, y);
        if (tile.at(x, y).fragmentCount == 0 || i % 13 != 0) continue;
        const TexelSampler sampler(s.scene, tile, tile.at(x, y));
        const Sobol4 numbers(combine(i, 77));
        std::vector<SurfacePoint> places;
        for (std::uint32_t k = 0; k < 128; ++k) places.push_back(sampler.at(numbers.point2(k)));
        glm::dvec3 exact(0.0);
        for (std::uint32_t l = 0; l < s.scene.lights.size(); ++l) exact += direct.punctual(places, l).illuminance;
        const glm::dvec3 d = glm::dvec3(b.values.direct[i]) - exact;
        squares += glm::dot(d, d) / 3.0;
        bias += (d.x + d.y + d.z) / 3.0;
        mean += (exact.x + exact.y + exact.z) / 3.0;
        n += 1.0;
      }
  }
  mean /= n;
  const double rms = std::sqrt(squares / n) / mean, off = bias / n / mean;
  std::printf("figure: 200 lamps, RMS %.2f %%, mean off by %+.3f %%, stated %.2f %%, bound %.2f %%, %zu texels\n", 100.0 * rms, 100.0 * off,
              100.0 * b.ledger.estimate, 100.0 * b.ledger.bound95, std::size_t(n));
  EXPECT_LT(rms, 1.25 * b.ledger.bound95) << "a sample of the texels, and the reference's own error";
  EXPECT_GT(rms, 0.4 * b.ledger.estimate) << "stated is not far above what is";
  EXPECT_LT(std::abs(off), 4.0 * rms / std::sqrt(n));
}

}  // namespace
}  // namespace lmc
