/// Rays at the places where floats decide: corners, edges, slivers, planes seen from their own edge. CGAL's exact kernel is the oracle: of
/// floats as they are, it says without rounding which triangles a ray meets, and where. Rows go to docs/stability.md.
#include <CGAL/Exact_predicates_exact_constructions_kernel.h>
#include <CGAL/intersections.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "libscene/rng.h"
#include "libscene/tracer.h"
#include "tests/support/hard_case.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

using test::expectWithin;
using Exact = CGAL::Exact_predicates_exact_constructions_kernel;

Exact::Point_3 exact(const glm::vec3& p) { return {double(p.x), double(p.y), double(p.z)}; }

/// What a ray meets first, in lengths of its direction; nothing when it leaves the level.
std::optional<double> exactClosest(const Scene& scene, const Ray& ray) {
  const Exact::Ray_3 line(exact(ray.origin_m), Exact::Vector_3(double(ray.direction.x), double(ray.direction.y), double(ray.direction.z)));
  std::optional<Exact::FT> nearest;
  for (const glm::uvec3& t : scene.triangles) {
    const Exact::Point_3 a = exact(scene.positions_m[t.x]), b = exact(scene.positions_m[t.y]), c = exact(scene.positions_m[t.z]);
    if (CGAL::collinear(a, b, c) || !CGAL::do_intersect(line, Exact::Triangle_3(a, b, c))) continue;
    const Exact::Vector_3 n = CGAL::cross_product(b - a, c - a);
    const Exact::FT along = n * line.to_vector();
    if (along == 0) continue;  // it runs within the triangle's plane: there is no one place where it meets
    const Exact::FT at = n * (a - line.source()) / along;
    if (!nearest || at < *nearest) nearest = at;
  }
  if (!nearest) return std::nullopt;
  return CGAL::to_double(*nearest);
}

double ulpOf(const Scene& scene) { return double(std::nextafter(scene.extent_m, std::numeric_limits<float>::infinity()) - scene.extent_m); }

/// How near a ray comes to the border of a triangle that it does or does not meet [m].
double nearestBorder_m(const Scene& scene, const Ray& ray) {
  const glm::dvec3 o(ray.origin_m), d = glm::normalize(glm::dvec3(ray.direction));
  double nearest = 1e300;
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    const auto c = scene.corners_m(t);
    for (std::size_t k = 0; k < 3; ++k) {
      // Of two lines; where they are parallel, of the edge's first corner and the ray.
      const glm::dvec3 e = c[(k + 1) % 3] - c[k], n = glm::cross(d, e), w = c[k] - o;
      const double l = glm::length(n);
      if (l < 1e-12 * glm::length(e)) {
        nearest = std::min(nearest, glm::length(w - glm::dot(w, d) * d));
        continue;
      }
      const double s = std::clamp(glm::dot(glm::cross(w, d), n) / (l * l), 0.0, 1.0);
      const glm::dvec3 p = w + s * e;
      nearest = std::min(nearest, glm::length(p - std::max(0.0, glm::dot(p, d)) * d));
    }
  }
  return nearest;
}

struct Judged {
  std::size_t missed = 0, invented = 0, wrongSides = 0;
  double farthest = 0.0;    ///< of a ray that is judged otherwise, from the next border [ulp of the level]
  double worstPlace = 0.0;  ///< distance from the exact plane of what was hit, square to it [ulp of the level]
};

Judged judge(const Scene& scene, const std::vector<Ray>& rays) {
  const Tracer tracer(scene);
  Judged out;
  for (const Ray& ray : rays) {
    const Hit hit = tracer.closest(ray, Purpose::Gather);
    const std::optional<double> at = exactClosest(scene, ray);
    out.wrongSides += tracer.occluded(ray, Purpose::Shadow) != bool(hit);
    const double ulp = ulpOf(scene);
    bool differs = bool(hit) != at.has_value();
    if (hit && at) {
      const auto c = scene.corners_m(hit.triangle);
      const glm::dvec3 n = glm::normalize(glm::cross(c[1] - c[0], c[2] - c[0])),
                       p = glm::dvec3(ray.origin_m) + *at * glm::dvec3(ray.direction);
      const double off = std::abs((double(hit.t) - *at) * glm::dot(n, glm::dvec3(ray.direction))) / ulp;
      // Another triangle was met, in front or behind: a matter of whether a border was passed.
      if (std::abs(glm::dot(p - c[0], n)) > 64.0 * ulp)
        differs = true;
      else
        out.worstPlace = std::max(out.worstPlace, off);
    }
    if (!differs) continue;
    out.missed += !hit;
    out.invented += !at;
    out.farthest = std::max(out.farthest, nearestBorder_m(scene, ray) / ulp);
  }
  return out;
}

glm::vec3 randomIn(std::uint32_t i, std::uint32_t salt, glm::vec3 lo, glm::vec3 hi) {
  const glm::vec4 u = Sobol4(combine(i, salt)).point(0);
  return lo + glm::vec3(u) * (hi - lo);
}

glm::vec3 turned(glm::vec3 p) {
  const glm::dvec3 axis = glm::normalize(glm::dvec3(1, 2, 3)), v(p);
  return glm::vec3(v * std::cos(0.3) + glm::cross(axis, v) * std::sin(0.3) + axis * glm::dot(axis, v) * (1.0 - std::cos(0.3)));
}

/// Half of the rays at vertices, half at places on edges.
std::vector<Ray> atBorders(const Scene& scene, std::uint32_t n, glm::vec3 lo, glm::vec3 hi) {
  std::vector<Ray> rays;
  for (std::uint32_t i = 0; i < n; ++i) {
    const glm::uvec3 t = scene.triangles[mix64(i) % scene.triangles.size()];
    const glm::vec3 a = scene.positions_m[t.x], b = scene.positions_m[t.y], from = randomIn(i, 5, lo, hi);
    const float along = i % 2 ? 0.0f : Sobol4(combine(i, 6)).point(0).x;
    rays.push_back({from, a + along * (b - a) - from, INFINITY});
  }
  return rays;
}

TEST(ExactRays, NoneLeavesAClosedRoomAtItsEdges) {
  for (const bool odd : {false, true}) {
    test::SceneBuilder b;
    const auto m = b.material(Rgb(0.5f));
    b.room({-3, -2, -4}, {3, 2, 4}, {m, m, m, m, m, m}, 6);
    if (odd)
      for (auto& p : b.scene.positions_m) p = turned(p);
    b.scene.extent_m = 6.0f;
    const Judged j = judge(b.scene, atBorders(b.scene, 4000, {-1, -1, -1}, {1, 1, 1}));
    const std::string what = odd ? "rays at edges and vertices of a turned room" : "rays at edges and vertices of a room";
    // The exact rays do not leave, either: faces share the vertices' floats, and so their edges.
    expectWithin({what, "rays that leave, of 4000", double(j.missed), 0.0, "", "edges are shared"});
    expectWithin({what, "farthest from the exact plane", j.worstPlace, 16.0, "ulp", "of the level's size: 3 products of 3 terms, and t"});
    EXPECT_EQ(j.wrongSides, 0u) << "occluded() and closest() agree";
  }
}

TEST(ExactRays, JunctionsInTheMiddleOfAnEdgeLetNoneThrough) {
  // A wall of one quad against a wall of five, whose edges end on the first one's: the corners lie on its edge exactly.
  test::SceneBuilder b(8);
  const auto m = b.material(Rgb(0.5f));
  b.quad({-4, -4, 0}, {4, 0, 0}, {0, 8, 0}, m);
  for (int k = 0; k < 5; ++k)
    b.quad({0, -4.0f + 1.6f * float(k), 0}, {4, 0, 0},
           {0, k < 4 ? -4.0f + 1.6f * float(k + 1) - (-4.0f + 1.6f * float(k)) : 4.0f - (-4.0f + 1.6f * 4.0f), 0}, m);
  b.scene.extent_m = 4.0f;
  std::vector<Ray> rays;
  for (std::uint32_t i = 0; i < 4000; ++i) {
    const glm::vec3 from = randomIn(i, 7, {-1, -1, 1}, {1, 1, 3});
    const glm::vec3 to = i % 2 ? glm::vec3(0.0f, -3.9f + 7.8f * Sobol4(combine(i, 8)).point(0).x, 0.0f)
                               : b.scene.positions_m[4 + mix64(i) % (b.scene.positions_m.size() - 4)];
    if (std::abs(to.y) > 3.95f || std::abs(to.x) > 3.95f) continue;
    rays.push_back({from, to - from, INFINITY});
  }
  const Judged j = judge(b.scene, rays);
  expectWithin({"rays at T-junctions", fmt::format("rays let through against the exact answer, of {}", rays.size()), double(j.missed), 0.0,
                "", "corners lie on the edge exactly"});
}

TEST(ExactRays, SliversAndOpenEdgesAreMetAsTheyLie) {
  // 400 loose triangles, needles up to 1e6 to 1 among them; rays at their edges and corners may go either way, but only within roundings.
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  for (std::uint32_t i = 0; i < 400; ++i) {
    const glm::vec3 a = randomIn(i, 11, {-4, -4, -4}, {4, 4, 4}), u = randomIn(i, 12, {-1, -1, -1}, {1, 1, 1}),
                    v = randomIn(i, 13, {-1, -1, -1}, {1, 1, 1}) * std::pow(10.0f, -float(i % 7));
    const glm::dvec3 corners[] = {glm::dvec3(a), glm::dvec3(a + u), glm::dvec3(a + v)};
    b.polygon(corners, m);
  }
  b.scene.extent_m = 5.0f;
  std::vector<Ray> rays = atBorders(b.scene, 2000, {-4, -4, -4}, {4, 4, 4});
  const Judged j = judge(b.scene, rays);
  const std::string what = "rays at borders of loose triangles, needles up to 1e6 to 1";
  expectWithin({what, fmt::format("farthest from a border, of the {} judged otherwise", j.missed + j.invented), j.farthest, 16.0, "ulp",
                "of the level's size: an edge test is 2 products of rounded differences"});
  expectWithin({what, "farthest from the exact plane", j.worstPlace, 16.0, "ulp", "of the level's size, as above"});
  EXPECT_EQ(j.wrongSides, 0u) << "occluded() and closest() agree";
}

TEST(ExactRays, WithinAPlaneOfAxesMeetNothingInIt) {
  // Rays along a floor, a shelf, a partition, in their very planes: the exact answer is that they run within, and meet what is across.
  test::SceneBuilder b;
  const auto m = b.material(Rgb(0.5f));
  b.room({-3, -2, -4}, {3, 2, 4}, {m, m, m, m, m, m}, 3);
  b.quad({-1, 0.5f, -1}, {2, 0, 0}, {0, 0, -2}, m, 4);
  b.quad({0.25f, -1, -1}, {0, 2, 0}, {0, 0, 2}, m, 4);
  std::vector<Ray> rays;
  for (std::uint32_t i = 0; i < 2000; ++i) {
    glm::vec3 from = randomIn(i, 21, {-2, -1, -3}, {2, 1, 3}), along = randomIn(i, 22, {-1, -1, -1}, {1, 1, 1});
    const int axis = i % 2 ? 1 : 0;
    from[axis] = i % 2 ? 0.5f : 0.25f;
    along[axis] = 0.0f;
    rays.push_back({from, along, INFINITY});
  }
  b.scene.extent_m = 5.0f;
  const Judged j = judge(b.scene, rays);
  expectWithin({"rays within the planes of a shelf and a partition", "rays that leave or meet what is not there, of 2000",
                double(j.missed + j.invented), 0.0, "", "the room is closed, and products with 0 are exact"});
  expectWithin(
      {"rays within the planes of a shelf and a partition", "farthest from the exact plane", j.worstPlace, 16.0, "ulp", "as above"});
}

}  // namespace
}  // namespace lmc
