/// Openness with closed forms: through places, maps and vertices.
#include <gtest/gtest.h>

#include <cmath>

#include "libao/ao.h"
#include "libradiosity/light_map.h"
#include "libscene/constants.h"
#include "libscene/scene_builder.h"

namespace lmc::ao {
namespace {

struct Baked {
  Openness openness;
  TexelArray<std::uint32_t> chart, object;
  int width = 0;

  /// f(texel index) for the covered texels of an object.
  template <class F>
  void forObject(std::uint32_t o, const F& f) const {
    for (std::size_t i = 0; i < chart.size(); ++i)
      if (chart[i] != kNone && object[i] == o) f(i);
  }
};

Baked bake(const Scene& scene, const Options& options, int side = 64) {
  const Run run;
  const Charts charts = findCharts(scene, side, run);
  const TexelMap texels(scene, charts, side);
  const LightMap map = startMap(scene, texels, run);
  return {bakeMap(scene, texels, map.chart, Tracer(scene), options, run), map.chart, map.object, side};
}

AtPlace at(const Scene& scene, const glm::dvec3& position_m, const glm::dvec3& normal, const Options& options = {},
           std::uint32_t rays = 16384) {
  SurfacePoint p;
  p.position_m = position_m;
  p.normal = p.geometricNormal = normal;
  return opennessAt(p, Tracer(scene), options, rays, 1, 0);
}

// 16384 rays of which edges cut off a share: error ~ 16384^-0.7 = 1e-3 with a constant below 1 (0.02 at 64 rays); a third of it is seen.
constexpr double kTolerance = 1e-3;

TEST(Openness, OfAnOpenPlaneIsExactlyOne) {
  SceneBuilder b;
  b.quad({-1, 0, -1}, {0, 0, 2}, {2, 0, 0}, b.material(Rgb(0.5f)));
  const Baked baked = bake(b.scene, {});
  EXPECT_GT(baked.openness.asked, 0u);
  baked.forObject(0, [&](std::size_t i) {
    EXPECT_EQ(baked.openness.cosine[i], 1.0f);
    EXPECT_EQ(baked.openness.uniform[i], 1.0f);
  });
  EXPECT_EQ(baked.openness.rmsError, 0.0);
}

TEST(Openness, OfAClosedBoxIsExactlyZero) {
  SceneBuilder b;
  const std::uint32_t m = b.material(Rgb(0.5f));
  b.room({-1, -1, -1}, {2, 1, 3}, {m, m, m, m, m, m});
  const Baked baked = bake(b.scene, {});
  EXPECT_GT(baked.openness.asked, 0u);
  for (std::size_t i = 0; i < baked.chart.size(); ++i) {
    EXPECT_EQ(baked.openness.cosine[i], 0.0f);
    EXPECT_EQ(baked.openness.uniform[i], 0.0f);
  }
  EXPECT_EQ(baked.openness.darkShare, 1.0);
}

TEST(Openness, OfAClosedRoomIsZeroWhereAPostGoesOnBelowItsFloor) {
  // The post's lower end lies outside, in the open: texels that the floor cuts are as dark as their middles above it.
  SceneBuilder b(4);
  const std::uint32_t m = b.material(Rgb(0.5f));
  b.room({-1, -1, -1}, {1, 1, 1}, {m, m, m, m, m, m});
  const float bottom = -1.43f, height = 1.6f;
  const std::uint32_t post = b.quad({0, bottom, -0.3f}, {0, height, 0}, {0, 0, 0.6f}, m);
  const int side = 128;
  const Baked baked = bake(b.scene, {.error = 0.003}, side);
  std::size_t cut = 0;
  baked.forObject(post, [&](std::size_t i) {
    // Corners of a quad lie at 0.1 and 0.9 of its cell; its first edge goes along x.
    const double cell = side / 4.0, texel = height / (0.8 * cell);
    const double y = double(bottom) + double(height) * ((double(i % std::size_t(cell)) + 0.5) / cell - 0.1) / 0.8;
    cut += std::abs(y + 1.0) < 0.5 * texel;
    if (y > -1.0) {
      EXPECT_EQ(baked.openness.cosine[i], 0.0f) << y;
    }
    if (y < -1.0 - texel) {
      EXPECT_GT(baked.openness.cosine[i], 0.1f) << y;
    }
  });
  EXPECT_GT(cut, 10u);
}

TEST(Openness, UnderASmallCeilingFollowsTheFormFactor) {
  // A disc-like square of side 2 at height 1, seen from below its middle: form factor to the parallel rectangle, four times the corner's.
  SceneBuilder b;
  b.quad({-1, 1, -1}, {2, 0, 0}, {0, 0, 2}, b.material(Rgb(0.5f)));
  const double x = 1.0, y = 1.0, r = std::sqrt(2.0);
  const double corner = (x / r * std::atan(y / r) + y / r * std::atan(x / r)) / (2.0 * kPi);
  const AtPlace open = at(b.scene, {0, 0, 0}, {0, 1, 0});
  EXPECT_NEAR(open.cosine, 1.0 - 4.0 * corner, kTolerance);
  // Uniform: its solid angle is a third of the hemisphere's 2 pi (a cube's face).
  EXPECT_NEAR(open.uniform, 2.0 / 3.0, kTolerance);
}

TEST(Openness, BacksOfFacesBlock) {
  SceneBuilder up, down;
  up.quad({-1, 1, -1}, {2, 0, 0}, {0, 0, 2}, up.material(Rgb(0.5f)));
  down.quad({-1, 1, -1}, {0, 0, 2}, {2, 0, 0}, down.material(Rgb(0.5f)));
  EXPECT_EQ(at(up.scene, {0, 0, 0}, {0, 1, 0}).cosine, at(down.scene, {0, 0, 0}, {0, 1, 0}).cosine);
}

TEST(Openness, OccludersBeyondTheDistanceDoNotCount) {
  SceneBuilder b;
  b.quad({-1, 1, -1}, {2, 0, 0}, {0, 0, 2}, b.material(Rgb(0.5f)));
  EXPECT_EQ(at(b.scene, {0, 0, 0}, {0, 1, 0}, {.distance_m = 0.99}).cosine, 1.0);
  EXPECT_LT(at(b.scene, {0, 0, 0}, {0, 1, 0}, {.distance_m = 1.01}).cosine, 1.0);
}

TEST(Openness, FallsOffWithTheDistance) {
  // Under an endless ceiling at height h, rays of cosine z are h/z long: blocked by (1 - h/(z D)) or its square where z > h/D = k.
  SceneBuilder b;
  b.quad({-1000, 1, -1000}, {2000, 0, 0}, {0, 0, 2000}, b.material(Rgb(0.5f)));
  const double k = 0.25;
  const Options linear{.distance_m = 4.0, .fallOff = FallOff::Linear}, quadratic{.distance_m = 4.0, .fallOff = FallOff::Quadratic};
  // Cosine: integral over z in (k, 1) of 2 z (1 - k/z) = 1 - k^2 - 2 k (1 - k); uniform: 1 - k + k ln k.
  const AtPlace l = at(b.scene, {0, 0, 0}, {0, 1, 0}, linear);
  EXPECT_NEAR(l.cosine, 1.0 - (1.0 - k * k - 2.0 * k * (1.0 - k)), kTolerance);
  EXPECT_NEAR(l.uniform, 1.0 - (1.0 - k + k * std::log(k)), kTolerance);
  // 2 z (1 - k/z)^2 = 2 z - 4 k + 2 k^2/z; (1 - k/z)^2 = 1 - 2 k/z + k^2/z^2.
  const AtPlace q = at(b.scene, {0, 0, 0}, {0, 1, 0}, quadratic);
  EXPECT_NEAR(q.cosine, 1.0 - (1.0 - k * k - 4.0 * k * (1.0 - k) - 2.0 * k * k * std::log(k)), kTolerance);
  EXPECT_NEAR(q.uniform, 1.0 - (1.0 - k + 2.0 * k * std::log(k) + k * k * (1.0 / k - 1.0)), kTolerance);
}

TEST(Openness, RaysBelowTheFaceAreBlockedAndCounted) {
  // Nothing in the way but the face itself, turned by 30 degrees from the shading normal: openness (1 + cos 30)/2 and 1 - 30/180.
  SceneBuilder b;
  b.quad({-1, -5, -1}, {0, 0, 2}, {2, 0, 0}, b.material(Rgb(0.5f)));
  SurfacePoint p;
  p.position_m = {0, 0, 0};
  p.normal = {0, 1, 0};
  p.geometricNormal = {0.5, std::sqrt(0.75), 0};
  const AtPlace open = opennessAt(p, Tracer(b.scene), {}, 16384, 1, 0);
  EXPECT_NEAR(open.cosine, 0.5 * (1.0 + std::sqrt(0.75)), kTolerance);
  EXPECT_NEAR(open.uniform, 5.0 / 6.0, kTolerance);
}

TEST(Openness, HolesOfMaskedMaterialsAreOpen) {
  SceneBuilder b;
  const std::uint32_t m = b.material(Rgb(0.5f));
  b.quad({-1, 1, -1}, {2, 0, 0}, {0, 0, 2}, m);
  b.scene.materials[m].alpha = Material::Alpha::Mask;
  b.scene.materials[m].baseColor.a = 0.2f;
  EXPECT_EQ(at(b.scene, {0, 0, 0}, {0, 1, 0}).cosine, 1.0);
  b.scene.materials[m].baseColor.a = 0.8f;
  EXPECT_LT(at(b.scene, {0, 0, 0}, {0, 1, 0}).cosine, 0.6);
}

/// A floor before a wall that does not end, for its size: texels far from the wall's ends.
Scene corner() {
  SceneBuilder b(2);
  const std::uint32_t m = b.material(Rgb(0.5f));
  b.quad({0, 0, -1}, {0, 0, 2}, {2, 0, 0}, m);
  b.quad({0, 0, -500}, {0, 500, 0}, {0, 0, 1000}, m);
  return b.scene;
}

TEST(BentNormals, LeanAwayFromAWall) {
  // Open is the quarter x > 0: the cosine-weighted mean of directions there is in proportion to (2/3, pi/3).
  const Baked baked = bake(corner(), {.bent = true, .rays = 4096}, 32);
  const glm::dvec3 expected = glm::normalize(glm::dvec3(2.0 / 3.0, kPi / 3.0, 0.0));
  baked.forObject(0, [&](std::size_t i) {
    EXPECT_NEAR(glm::length(baked.openness.bent[i]), 1.0f, 1e-5f);
    EXPECT_LT(glm::distance(glm::dvec3(baked.openness.bent[i]), expected), 0.01) << i;
    EXPECT_NEAR(baked.openness.cosine[i], 0.5f, 0.005f) << "no rim: the same up to the wall";
  });
}

TEST(BentNormals, AreTheNormalWhereNothingIsOpen) {
  SceneBuilder b;
  const std::uint32_t m = b.material(Rgb(0.5f));
  b.room({-1, -1, -1}, {1, 1, 1}, {m, m, m, m, m, m});
  const Baked baked = bake(b.scene, {.bent = true}, 64);
  for (std::uint32_t o = 0; o < 6; ++o)
    baked.forObject(o, [&](std::size_t i) {
      EXPECT_LT(glm::distance(baked.openness.bent[i], b.scene.normals[b.scene.objects[o].firstVertex]), 1e-5f);
    });
}

TEST(Openness, MeetsTheErrorAskedForAndSaysSo) {
  // Floor texels under a ceiling: the form factor of a parallel rectangle at each texel's middle is the truth.
  SceneBuilder b(1);
  const std::uint32_t m = b.material(Rgb(0.5f));
  b.quad({-2, 0, -2}, {0, 0, 4}, {4, 0, 0}, m);
  Scene scene = b.scene;
  SceneBuilder lid(1);
  lid.quad({-1, 0.5f, -1}, {2, 0, 0}, {0, 0, 2}, lid.material(Rgb(0.5f)));
  const auto first = std::uint32_t(scene.positions_m.size());
  for (std::size_t v = 0; v < lid.scene.positions_m.size(); ++v) {
    scene.positions_m.push_back(lid.scene.positions_m[v]);
    scene.normals.push_back(lid.scene.normals[v]);
    scene.uv0.emplace_back(0.0f);
    scene.mapUv.emplace_back(0.0f);
    scene.sourceVertex.push_back(std::uint32_t(v));
  }
  Object o = lid.scene.objects[0];
  o.receive = o.inMap = false;
  o.firstTriangle = std::uint32_t(scene.triangles.size());
  o.firstVertex = first;
  for (const glm::uvec3& t : lid.scene.triangles) scene.triangles.push_back(first + t);
  scene.objects.push_back(o);
  scene.triangleObject.resize(scene.triangles.size(), 1);

  const auto cornerFactor = [](double a, double c, double h) {
    const double x = a / h, y = c / h, rx = std::sqrt(1.0 + x * x), ry = std::sqrt(1.0 + y * y);
    return (x / rx * std::atan(y / rx) + y / ry * std::atan(x / ry)) / (2.0 * kPi);
  };
  const auto blocked = [&](double px, double pz) {
    double sum = 0.0;
    for (const double ex : {-1.0, 1.0})
      for (const double ez : {-1.0, 1.0}) sum += ex * ez * cornerFactor(ex - px, ez - pz, 0.5);
    return sum;
  };
  for (const double error : {0.02, 0.005}) {
    const int side = 48;
    const Baked baked = bake(scene, {.error = error}, side);
    double squares = 0.0, n = 0.0;
    baked.forObject(0, [&](std::size_t i) {
      // The quad's cell has a margin of a tenth; u runs along z, v along x.
      const double u = ((double(i % side) + 0.5) / side - 0.1) / 0.8, v = ((double(i / side) + 0.5) / side - 0.1) / 0.8;
      if (u < 0.02 || v < 0.02 || u > 0.98 || v > 0.98) return;  // texels cut by the chart's border have another middle
      const double truth = 1.0 - blocked(-2.0 + 4.0 * v, -2.0 + 4.0 * u);
      squares += (double(baked.openness.cosine[i]) - truth) * (double(baked.openness.cosine[i]) - truth);
      n += 1.0;
    });
    const double true_ = std::sqrt(squares / n);
    EXPECT_LE(true_, error);
    EXPECT_LE(baked.openness.rmsError, error);
    // The statement is of the larger weighting's error: the uniform one's may be 1.5 times the cosine's.
    EXPECT_GT(true_, baked.openness.rmsError / 2.5);
    EXPECT_LT(true_, baked.openness.rmsError * 1.5);
  }
}

TEST(Openness, NoDarkRimAtTheFootOfAWallOnAnUncutFloor) {
  // A solid block stands on a floor that goes on below it; its sides lie within texels of the floor.
  SceneBuilder b(4);
  const std::uint32_t m = b.material(Rgb(0.5f));
  b.quad({-2, 0, -2}, {0, 0, 4}, {4, 0, 0}, m);
  const glm::vec3 lo(-0.53f, -0.1f, -0.53f), d(1.06f, 1.1f, 1.06f), X(d.x, 0, 0), Y(0, d.y, 0), Z(0, 0, d.z);
  b.quad(lo, Z, Y, m);  // fronts outwards
  b.quad(lo + X, Y, Z, m);
  b.quad(lo, Y, X, m);
  b.quad(lo + Z, X, Y, m);
  b.quad(lo + Y, Z, X, m);
  const int side = 128;
  Options near{.error = 0.005};
  near.distance_m = 0.3;
  near.fallOff = FallOff::Linear;
  for (const Options& options : {Options{.error = 0.005}, near}) {
    const bool all = std::isinf(options.distance_m);
    SCOPED_TRACE(options.distance_m);
    const Baked baked = bake(b.scene, options, side);
    const TexelArray<float> shown = withoutRims(baked.openness, baked.chart, side);
    std::size_t looked = 0, buried = 0;
    baked.forObject(0, [&](std::size_t i) {
      const double cell = side / 4.0;
      const double z = -2.0 + 4.0 * ((double(i % side) + 0.5) / cell - 0.1) / 0.8,
                   x = -2.0 + 4.0 * ((double(i / side) + 0.5) / cell - 0.1) / 0.8;
      const double texel = 4.0 / (0.8 * cell), away = std::max(std::abs(x), std::abs(z)) - 0.53;
      if (std::abs(x) > 0.4 && std::abs(z) > 0.4) return;  // at the block's edges the wall ends
      // At the foot of a wall half is open, less what its end leaves, and more where it counts less for being away; texels that a lookup at
      // the foot reads, within one texel, show that.
      if (away > -0.49 * texel && away < texel) {
        EXPECT_GT(shown[i], 0.45f) << x << ' ' << z;
        EXPECT_LT(shown[i], all ? 0.75f : 0.95f) << x << ' ' << z;
        ++looked;
      }
      buried += baked.openness.buried[i] != 0;
      // Rays that end meet nothing from a place deep inside; the others all meet the block.
      if (all && away < -2.0 * texel) {
        EXPECT_EQ(baked.openness.cosine[i], 0.0f);
      }
    });
    EXPECT_GT(looked, 20u);
    if (all) {
      EXPECT_GT(buried, 10u);
    }
  }
}

TEST(Openness, NoDarkRimAtTheFootOfWallsThatLeaveLittleOpen) {
  // An alley between two solid blocks on a floor that goes on below them: so little of it is open that places which see nothing are common
  // in it. Each side of the alley cuts texels whose middles are free.
  SceneBuilder b(4);
  const std::uint32_t m = b.material(Rgb(0.5f));
  b.quad({-2, 0, -2}, {0, 0, 4}, {4, 0, 0}, m);
  const double near = -0.12, far = 0.22, height = 1.0;
  const auto block = [&](float from, float to) {
    const glm::vec3 lo(-50, -0.1f, from), X(100, 0, 0), Y(0, 0.1f + float(height), 0), Z(0, 0, to - from);
    b.quad(lo, Z, Y, m);  // fronts outwards
    b.quad(lo + X, Y, Z, m);
    b.quad(lo, Y, X, m);
    b.quad(lo + Z, X, Y, m);
    b.quad(lo + Y, Z, X, m);
  };
  block(-1.0f, float(near));
  block(float(far), 1.0f);
  const int side = 256;
  const Baked baked = bake(b.scene, {.error = 0.005}, side);
  const double cell = side / 4.0, texel = 4.0 / (0.8 * cell);
  double squares = 0.0, stated = 0.0, cut = 0.0;
  baked.forObject(0, [&](std::size_t i) {
    const double z = -2.0 + 4.0 * ((double(i % side) + 0.5) / cell - 0.1) / 0.8,
                 x = -2.0 + 4.0 * ((double(i / side) + 0.5) / cell - 0.1) / 0.8;
    if (std::abs(x) > 1.5 || z < near || z > far) return;
    // Of an endless alley (the ends let in less than 1e-3), at the middle of the part of the texel that is free.
    const double at = 0.5 * (std::max(z - 0.5 * texel, near) + std::min(z + 0.5 * texel, far));
    const auto sine = [&](double away) { return away / std::sqrt(away * away + height * height); };
    const double open = 0.5 * (sine(at - near) + sine(far - at));
    ASSERT_LT(open, 0.2);
    if (z - near >= 0.5 * texel && far - z >= 0.5 * texel) return;
    const double off = double(baked.openness.cosine[i]) - open;
    squares += off * off;
    stated += double(baked.openness.error[i]) * double(baked.openness.error[i]);
    cut += 1.0;
  });
  EXPECT_GT(cut, 40.0);
  // What is stated of a texel is its pool's, four texels wide, of which all of the variance may lie in those that are cut.
  EXPECT_LT(std::sqrt(squares / cut), 2.0 * std::sqrt(stated / cut));
}

TEST(VertexOpenness, IsOneOutsideAndHalfAlongAnInnerEdge) {
  const Scene scene = corner();
  const Openness all = bakeVertices(scene, Tracer(scene), {.error = 0.002}, {});
  ASSERT_EQ(all.cosine.size(), scene.positions_m.size());
  // The floor before the wall: half open wherever it is.
  for (int v = 0; v < 4; ++v) EXPECT_NEAR(all.cosine[std::size_t(v)], 0.5f, 0.01f);
  SceneBuilder b;
  b.quad({-1, 0, -1}, {0, 0, 2}, {2, 0, 0}, b.material(Rgb(0.5f)));
  for (const float open : bakeVertices(b.scene, Tracer(b.scene), {}, {}).cosine) EXPECT_EQ(open, 1.0f);
}

TEST(VertexOpenness, VerticesThatDifferInUvsAloneAreOne) {
  // Two squares side by side under a lid, each with vertices of its own: along the common edge there is no seam.
  SceneBuilder b;
  const std::uint32_t m = b.material(Rgb(0.5f));
  b.quad({-1, 0, 0}, {0, 0, 1}, {1, 0, 0}, m);
  b.quad({0, 0, 0}, {0, 0, 1}, {1, 0, 0}, m);
  b.quad({-1, 0.3f, 0}, {1, 0, 0}, {0, 0, 1}, m);
  const Openness all = bakeVertices(b.scene, Tracer(b.scene), {}, {});
  int shared = 0;
  for (std::size_t v = 0; v < 4; ++v)
    for (std::size_t w = 4; w < 8; ++w)
      if (b.scene.positions_m[v] == b.scene.positions_m[w]) {
        EXPECT_EQ(all.cosine[v], all.cosine[w]);
        ++shared;
      }
  EXPECT_EQ(shared, 2);
}

}  // namespace
}  // namespace lmc::ao
