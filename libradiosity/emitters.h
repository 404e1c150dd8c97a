#pragma once
/// Emissive triangles as area lights: closed form for what they give unoccluded, places on them for shadow rays.
#include <array>
#include <vector>

#include "libscene/run.h"
#include "libscene/scene.h"

namespace lmc {

/// A piece of an emissive triangle; a double-sided material gives two, back to back.
struct Emitter {
  std::uint32_t triangle = 0;
  std::array<glm::vec2, 3> bary;             ///< weights of its corners in the triangle; counter-clockwise seen from the side that shines
  std::array<glm::dvec3, 3> corner_m;
  glm::dvec3 normal{0.0};                    ///< unit
  double area_m2 = 0.0;
  Rgb radiance{0.0f};                        ///< area mean [cd/m^2]
  bool textured = false;
};

/// Pieces no longer than `maxEdge_m` as long as there are at most `maxCount` of them: with them, choosing a piece by what it would give
/// is most of the way to choosing a place by what it would give.
std::vector<Emitter> findEmitters(const Scene&, std::size_t maxCount, const Run&);

/// Largest channel, by which emitters are chosen.
inline float strength(const Rgb& c) { return std::max({c.r, c.g, c.b}); }

}  // namespace lmc
