/// Reference cases of ambient occlusion, through libao.
#include <cmath>
#include <memory>

#include "libao/ao.h"
#include "libscene/constants.h"
#include "libscene/rng.h"
#include "libscene/scene_builder.h"
#include "lmc/verify_case.h"

namespace lmc {

namespace {

using V = glm::vec3;

// Of each scramble. No power of two: whole nets have one ray in each stratum of elevation, and where an edge runs along a circle of
// latitude all scrambles could be off by the same ray, which their spread would not show.
constexpr std::uint32_t kRays = 2 * 3008;
constexpr int kLeastScrambles = 8, kMostScrambles = 1024;
constexpr float kEndless = 1e5f;  // stands for infinite: what lies beyond is about 1e-5 of the hemisphere
constexpr int kSegments = 4096;   // of a round wall: (pi/4096)^2/2 = 3e-7 off in its radius

/// A scene, a place in it and what the rays are. The face that an endless scene's place lies on is left out, for no ray goes there; and
/// rays start at the place itself, not lifted off it by the rounding of endless coordinates.
class Place {
 public:
  Place(SceneBuilder b, glm::dvec3 position_m, glm::dvec3 normal, double distance_m = INFINITY)
      : scene_(std::move(b.scene)), tracer_(scene_) {
    point_.position_m = scene_.extent_m >= kEndless ? position_m - double(tracer_.lift_m()) * normal : position_m;
    point_.normal = point_.geometricNormal = normal;
    options_.distance_m = distance_m;
  }

  Got sample(double standardError, bool cosine, std::uint64_t seed) const {
    return sampleUntil(standardError, kLeastScrambles, kMostScrambles, [&](int k) {
      const ao::AtPlace open = ao::opennessAt(point_, tracer_, options_, kRays, seed, std::uint32_t(k));
      return cosine ? open.cosine : open.uniform;
    });
  }

 private:
  Scene scene_;
  Tracer tracer_;
  SurfacePoint point_;
  ao::Options options_;
};

Evaluate at(std::shared_ptr<const Place> place, std::uint64_t seed) {
  return [place, seed](const Wanted& w) -> std::optional<Got> {
    if (w.name != "openness_cosine" && w.name != "openness_uniform") return std::nullopt;
    Got got = place->sample(w.standardError, w.name == "openness_cosine", seed);
    got.rounding = 1e-6;
    return got;
  };
}

SceneBuilder empty() {
  SceneBuilder b(32);
  b.material(Rgb(0.5f));
  return b;
}

Evaluate wedge(const Parameters& g, const VerifyContext& c) {
  const double a = g.angle_rad("angle");
  SceneBuilder b = empty();
  // Faces meet along z; the place lies on y = 0 at x = 1.
  b.quad({0, 0, -kEndless}, {0, 0, 2 * kEndless}, kEndless * V(float(std::cos(a)), float(std::sin(a)), 0), 0);
  return at(std::make_shared<Place>(std::move(b), glm::dvec3(1, 0, 0), glm::dvec3(0, 1, 0)), c.seed);
}

Evaluate wall(const Parameters& g, const VerifyContext& c) {
  const double distance = g.number("distance"), height = g.numberOr("height", double(kEndless));
  SceneBuilder b = empty();
  b.quad({float(distance), 0, -kEndless}, {0, 0, 2 * kEndless}, {0, float(height), 0}, 0);
  const double range = g.numberOr("range", INFINITY);
  return at(std::make_shared<Place>(std::move(b), glm::dvec3(0), glm::dvec3(0, 1, 0), range), c.seed);
}

/// x = `x`, from y = -depth up to 0.
void trenchSide(SceneBuilder& b, double x, double depth) {
  b.quad({float(x), float(-depth), -kEndless}, {0, 0, 2 * kEndless}, {0, float(depth), 0}, 0);
}

Evaluate trench(const Parameters& g, const VerifyContext& c) {
  const double depth = g.number("depth");
  SceneBuilder b = empty();
  trenchSide(b, 0.0, depth);
  trenchSide(b, g.number("width"), depth);
  return at(std::make_shared<Place>(std::move(b), glm::dvec3(g.number("x"), -depth, 0), glm::dvec3(0, 1, 0)), c.seed);
}

Evaluate trenchWall(const Parameters& g, const VerifyContext& c) {
  const double width = g.number("width"), below = g.number("y_below_rim");
  // A floor closes it: what lies deeper is as dark.
  const double depth = below + 1.0;
  SceneBuilder b = empty();
  trenchSide(b, width, depth);
  b.quad({0, float(-depth), -kEndless}, {0, 0, 2 * kEndless}, {float(width), 0, 0}, 0);
  return at(std::make_shared<Place>(std::move(b), glm::dvec3(0, -below, 0), glm::dvec3(1, 0, 0)), c.seed);
}

/// A round wall of radius 1 * radius, its rim at y = 0, and its floor.
SceneBuilder wellOf(float radius, float depth) {
  SceneBuilder b = empty();
  std::vector<V> positions, normals;
  std::vector<glm::uvec3> triangles;
  for (int k = 0; k < kSegments; ++k) {
    const double angle = 2.0 * kPi * k / kSegments;
    const V out(float(std::cos(angle)), 0, float(std::sin(angle)));
    for (const float y : {0.0f, -depth}) {
      positions.push_back(radius * out + V(0, y, 0));
      normals.push_back(-out);
    }
    const auto i = unsigned(2 * k), j = unsigned(2 * ((k + 1) % kSegments));
    triangles.insert(triangles.end(), {{i, i + 1, j}, {j, i + 1, j + 1}});
  }
  b.mesh(positions, normals, std::vector<glm::vec2>(positions.size()), triangles, 0);
  b.quad({-radius, -depth, -radius}, {0, 0, 2 * radius}, {2 * radius, 0, 0}, 0);
  return b;
}

Evaluate well(const Parameters& g, const VerifyContext& c) {
  const double depth = g.number("depth"), off = g.numberOr("offset", 0.0);
  return at(std::make_shared<Place>(wellOf(float(g.number("radius")), float(depth)), glm::dvec3(off, -depth, 0), glm::dvec3(0, 1, 0)),
            c.seed);
}

Evaluate wellWall(const Parameters& g, const VerifyContext& c) {
  const double radius = g.number("radius"), below = g.number("y_below_rim");
  // Half way along a segment, on it: the faces beside must not stand before the place.
  const double middle = kPi / kSegments, apothem = radius * std::cos(middle);
  const glm::dvec3 out(std::cos(middle), 0, std::sin(middle));
  return at(std::make_shared<Place>(wellOf(float(radius), float(below + 1.0)), apothem * out - glm::dvec3(0, below, 0), -out), c.seed);
}

/// A sphere of radius 1 without the cap of that half angle about +y. Its bottom is a vertex: the place is the middle of a face beside it.
Evaluate bowl(const Parameters& g, const VerifyContext& c) {
  const double cap = g.angle_rad("opening_half_angle");
  constexpr int kRings = 512, kRound = 1024;
  SceneBuilder b = empty();
  std::vector<V> positions{V(0, -1, 0)}, normals{V(0, 1, 0)};
  std::vector<glm::uvec3> triangles;
  for (int r = 1; r <= kRings; ++r)
    for (int k = 0; k < kRound; ++k) {
      const double polar = kPi - (kPi - cap) * r / kRings, round = 2.0 * kPi * k / kRound;
      positions.emplace_back(float(std::sin(polar) * std::cos(round)), float(std::cos(polar)), float(std::sin(polar) * std::sin(round)));
      normals.push_back(-positions.back());
    }
  const auto id = [&](int ring, int k) { return unsigned(1 + (ring - 1) * kRound + k % kRound); };
  for (int k = 0; k < kRound; ++k) triangles.emplace_back(0u, id(1, k + 1), id(1, k));
  for (int r = 1; r < kRings; ++r)
    for (int k = 0; k < kRound; ++k)
      triangles.insert(triangles.end(), {{id(r, k), id(r, k + 1), id(r + 1, k)}, {id(r + 1, k), id(r, k + 1), id(r + 1, k + 1)}});
  b.mesh(positions, normals, std::vector<glm::vec2>(positions.size()), triangles, 0);
  // A little above the vertex, where no face that leans towards it is in the way.
  return at(std::make_shared<Place>(std::move(b), glm::dvec3(0, -1, 0), glm::dvec3(0, 1, 0)), c.seed);
}

Evaluate box(const Parameters& g, const VerifyContext& c) {
  const std::vector<double> x = g["x"].numbers(), y = g["y"].numbers();
  if (x.size() != 2 || y.size() != 2) g.broken("'x' and 'y' are no ranges");
  const glm::dvec3 p = g["point"].vec3();
  const V lo(float(x[0]), float(y[0]), 0), d(float(x[1] - x[0]), float(y[1] - y[0]), float(g.number("height")));
  SceneBuilder b = empty();
  b.quad(lo, {d.x, 0, 0}, {0, d.y, 0}, 0);
  b.quad(lo, {0, d.y, 0}, {0, 0, d.z}, 0);
  b.quad(lo + V(d.x, 0, 0), {0, 0, d.z}, {0, d.y, 0}, 0);
  b.quad(lo, {0, 0, d.z}, {d.x, 0, 0}, 0);
  b.quad(lo + V(0, d.y, 0), {d.x, 0, 0}, {0, 0, d.z}, 0);
  return at(std::make_shared<Place>(std::move(b), p, glm::dvec3(0, 0, 1)), c.seed);
}

Evaluate corner(const Parameters& g, const VerifyContext& c) {
  if (g["scene"].text() != "octant") throw LeftOut{"a corner called '" + g["scene"].text() + "' is not known"};
  SceneBuilder b = empty();
  b.quad(V(0), {0, kEndless, 0}, {0, 0, kEndless}, 0);
  b.quad(V(0), {kEndless, 0, 0}, {0, kEndless, 0}, 0);
  return at(std::make_shared<Place>(std::move(b), glm::dvec3(1, 0, 1), glm::dvec3(0, 1, 0)), c.seed);
}

Evaluate trivial(const Parameters& g, const VerifyContext& c) {
  SceneBuilder b = empty();
  if (g["scene"].text() == "open plane")
    b.quad({-1, 0, -1}, {0, 0, 2}, {2, 0, 0}, 0);
  else if (g["scene"].text() == "closed box")
    b.room(V(-1), V(1), {0, 0, 0, 0, 0, 0});
  else
    throw LeftOut{"a scene called '" + g["scene"].text() + "' is not known"};
  const double height = g["scene"].text() == "open plane" ? 0.0 : -1.0;
  return at(std::make_shared<Place>(std::move(b), glm::dvec3(0.25, height, 0.125), glm::dvec3(0, 1, 0)), c.seed);
}

}  // namespace

std::vector<CaseKind> aoKinds() {
  return {{"ao/wedge", wedge},   {"ao/wall", wall},      {"ao/range", wall},        {"ao/trench", trench}, {"ao/trenchwall", trenchWall},
          {"ao/well", well},     {"ao/well_off", well},  {"ao/wellwall", wellWall}, {"ao/bowl", bowl},     {"ao/box", box},
          {"ao/corner", corner}, {"ao/trivial", trivial}};
}

}  // namespace lmc
