#pragma once
/// What each triangle says by itself: the directions along which U and V grow on it.
#include "libtangent/mesh.h"

namespace lmc::tangent {

/// Bits of Frame::flags.
inline constexpr std::uint32_t kPreserving = 1;  ///< its UVs run round as its corners do: the reference's sign is +1
inline constexpr std::uint32_t kFrameless =
    2;  ///< no area in UV to speak of, or a direction without length: may join any group, adds nothing
inline constexpr std::uint32_t kDegenerate = 4;  ///< two positions are equal: takes no part until the others are done
inline constexpr std::uint32_t kLoneHalf = 8;    ///< of a quad whose other half alone, or which alone, is degenerate

/// 32 bytes, half a cache line: one is read for each corner of each ring.
struct Frame {
  glm::vec3 s;  ///< unit: U grows along it; zero when frameless
  std::uint32_t flags;
  glm::vec3 t;   ///< the same of V
  float uvArea;  ///< |twice the signed area in UV|
};

struct Frames {
  Array<Frame> of;                        ///< per triangle
  Array<glm::vec2> magnitudes;            ///< per triangle, lengths of the derivatives [position per UV]; only with quads
  std::vector<std::uint32_t> frameless;   ///< triangles, ascending; no degenerate ones
  std::vector<std::uint32_t> degenerate;  ///< triangles, ascending
};

Frames framesOf(const Mesh&, const Loop&);

}  // namespace lmc::tangent
