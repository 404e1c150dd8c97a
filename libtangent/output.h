#pragma once
/// Where tangents go, and what is noted of those that cannot stay as they are.
#include <cstring>

#include "libtangent/rings.h"
#include "libtangent/vectors.h"

namespace lmc::tangent {

/// A corner of the surface whose reference tangent does not serve.
struct Bad {
  std::uint32_t corner;    ///< of the surface
  std::uint32_t id;        ///< of its vertex
  std::uint32_t triangle;  ///< kNoTriangle: its face has none
  Mend why;
};
inline constexpr std::uint32_t kNoTriangle = ~0u;

/// Farthest from orthogonal, cosine, and from unit length, in squares, that a tangent in a file may be.
inline constexpr float kMaxCosine = 1e-3f, kMaxSquareError = 1.8e-5f;

/// Whether a tangent serves as it is. One that is off a normal that is not of unit length serves when it is near enough either to what is
/// stored or to its direction.
inline bool serves(glm::vec3 tangent, glm::vec3 normal, Mend& why) {
  const float square = glm::dot(tangent, tangent);
  if (std::abs(square - 1.0f) <= kMaxSquareError) {
    const float off = std::abs(glm::dot(normal, tangent));
    if (!(off > kMaxCosine) || !(off > kMaxCosine * std::sqrt(glm::dot(normal, normal)))) return true;
    why = Mend::NotOrthogonal;
    return false;
  }
  why = !std::isfinite(square) ? Mend::NotFinite : square < 1e-12f ? Mend::Zero : Mend::NotUnit;
  return false;
}

/// Corners as they are written: 4 floats each. In exact mode the reference's sign goes out, else its opposite, the determinant; and 0 for
/// corners that nothing reached, until they are mended.
class Output {
 public:
  Output(float* corners, bool exact) : corners_(corners), exact_(exact) {}

  void write(std::uint32_t corner, glm::vec3 tangent, float determinant) const {
    const float record[4] = {tangent.x, tangent.y, tangent.z, determinant};
    std::memcpy(corners_ + 4 * std::size_t(corner), record, sizeof record);
  }
  void writeFiller(std::uint32_t corner) const { write(corner, {1.0f, 0.0f, 0.0f}, exact_ ? -1.0f : 0.0f); }
  void copy(std::uint32_t to, std::uint32_t from) const {
    std::memcpy(corners_ + 4 * std::size_t(to), corners_ + 4 * std::size_t(from), 4 * sizeof(float));
  }
  void prefetch(std::uint32_t corner) const { __builtin_prefetch(corners_ + 4 * std::size_t(corner), 1); }
  glm::vec3 tangent(std::uint32_t corner) const {
    const float* c = corners_ + 4 * std::size_t(corner);
    return {c[0], c[1], c[2]};
  }
  float determinant(std::uint32_t corner) const { return corners_[4 * std::size_t(corner) + 3]; }
  /// What is stored for triangles of an orientation.
  float determinantOf(std::uint32_t flags) const { return ((flags & kPreserving) != 0) == exact_ ? 1.0f : -1.0f; }
  bool exact() const { return exact_; }

 private:
  float* corners_;
  bool exact_;
};

/// What a stretch of vertices left to do and to say.
struct Remarks {
  std::vector<Bad> bad;
  std::size_t groups = 0, hugeGroups = 0;
};

}  // namespace lmc::tangent
