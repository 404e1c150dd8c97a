#pragma once
/// Emissive triangles as area lights: closed form for what they give unoccluded, places on them for shadow rays.
#include <algorithm>
#include <array>
#include <vector>

#include "libscene/scene.h"

namespace lmc {

/// An emissive triangle or a piece of one; a double-sided material gives two, back to back.
struct Emitter {
  std::uint32_t triangle = 0;
  std::array<glm::vec2, 3> bary;  ///< weights of its corners in the triangle; counter-clockwise seen from the side that shines
  std::array<glm::dvec3, 3> corner_m;
  glm::dvec3 normal{0.0};  ///< unit
  double area_m2 = 0.0;
  double longest2_m2 = 0.0;  ///< square of the longest edge
  Rgb radiance{0.0f};        ///< area mean, holes included as dark [cd/m^2]
  bool textured = false;
  std::uint32_t whole = 0;                       ///< of a piece: the number of what it is a piece of
  std::uint32_t firstPiece = 0, pieceCount = 0;  ///< of a whole
};

struct Emitters {
  std::vector<Emitter> whole;  ///< for the closed form: triangles, but pieces where a texture or holes make them uneven
  std::vector<Emitter>
      pieces;  ///< for shadow rays, by whole: choosing a piece by what it would give is most of the way to choosing a place
};

/// Halves the longest pieces until there are `maxPieces` (or more emissive triangles than that), or none is long against the level.
Emitters findEmitters(const Scene&, std::size_t maxPieces);

/// Largest channel, by which emitters are chosen.
inline float strength(const Rgb& c) { return std::max({c.r, c.g, c.b}); }

}  // namespace lmc
