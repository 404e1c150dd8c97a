#pragma once
/// What each triangle says by itself: the directions along which U and V grow on it, and what its corners add to their vertices' sums.
#include "libtangent/mesh.h"

namespace lmc::tangent {

/// Bits of Frame::flags.
inline constexpr std::uint32_t kPreserving = 1;  ///< its UVs run round as its corners do: the reference's sign is +1
inline constexpr std::uint32_t kFrameless = 2;   ///< no area in UV to speak of, or no derivative: may join any group, adds nothing
inline constexpr std::uint32_t kDegenerate = 4;  ///< two positions are equal: takes no part until the others are done
inline constexpr std::uint32_t kLoneHalf = 8;    ///< of a quad of which one half is degenerate and the other is not
/// << corner. In the plane of the normal there: S is so short that rounding has the word; or S and T are less than 45 degrees from lying on
/// one line, or turn the other way than the orientation says.
inline constexpr std::uint32_t kUnsteady = 32, kSkewed = 256;
/// T in steps of 1/63, 7 bits an axis from bit 11 on: enough to see whether two of them may be opposite.
inline constexpr int kShortShift = 11, kShortBits = 7;
inline constexpr float kShortSteps = 63.0f;

/// Derivatives over a triangle.
struct Derivatives {
  glm::vec3 s{0.0f}, t{0.0f};  ///< unit: U and V grow along them, turned about where the UVs are mirrored; zero when frameless
  float ms = 0.0f, mt = 0.0f;  ///< lengths of dp/du and dp/dv
  float uvArea = 0.0f;         ///< |twice the area in UV|
};
Derivatives derivativesOf(const Mesh&, std::size_t triangle);

/// A triangle as rings read it: one cache line.
struct alignas(64) Frame {
  float weighted[3]
                [4];  ///< per corner: S in the plane of the normal there, unit, times the corner's angle [rad]; then that. Frameless: zero
  std::uint32_t ids[3];
  std::uint32_t flags;
};

struct Frames {
  Array<Frame> of;                        ///< per triangle
  std::vector<std::uint32_t> frameless;   ///< triangles, ascending; no degenerate ones
  std::vector<std::uint32_t> degenerate;  ///< triangles, ascending
};

Frames framesOf(const Mesh&, const Loop&);

}  // namespace lmc::tangent
