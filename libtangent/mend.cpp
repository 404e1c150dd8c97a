#include "libtangent/mend.h"

#include <algorithm>
#include <cmath>

namespace lmc::tangent {

namespace {

constexpr std::size_t kGrain = 4096;  // corners
constexpr double kLeastSine = 1e-3;   // a direction closer to the normal says nothing about the plane

bool isFinite(glm::dvec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

/// Unit, or zero where there is no direction.
glm::dvec3 directionOf(glm::dvec3 v) {
  if (!isFinite(v)) return glm::dvec3(0.0);
  const double length = glm::length(v);
  return length > 0.0 ? v / length : glm::dvec3(0.0);
}

/// A unit vector orthogonal to the unit vector n, without a branch that could flip it: [duff2017], listing 3, first axis.
glm::dvec3 anyTangent(glm::dvec3 n) {
  const double sign = std::copysign(1.0, n.z), a = -1.0 / (sign + n.z), b = n.x * n.y * a;
  return {1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x};
}

/// The part of v in the plane of n, as a direction; zero where v lies along n.
glm::dvec3 within(glm::dvec3 n, glm::dvec3 v) {
  const glm::dvec3 d = directionOf(v), flat = d - glm::dot(n, d) * n;
  return glm::length(flat) > kLeastSine ? glm::normalize(flat) : glm::dvec3(0.0);
}

bool isZero(glm::dvec3 v) { return v == glm::dvec3(0.0); }

/// In this order: what is there, turned into the plane; the triangle's own S; what is orthogonal to its own T; any tangent of the normal.
glm::vec3 mendedTangent(glm::dvec3 normal, glm::dvec3 old, const Derivatives* own, double sign) {
  const glm::dvec3 n = directionOf(normal);  // zero: every direction is as good as another
  glm::dvec3 t = within(n, old);
  if (isZero(t) && own) t = within(n, glm::dvec3(own->s));
  // V grows along sign * cross(n, t), so t = sign * cross(V, n).
  if (isZero(t) && own && !isZero(n)) t = directionOf(sign * glm::cross(within(n, glm::dvec3(own->t)), n));
  if (isZero(t)) t = isZero(n) ? glm::dvec3(1.0, 0.0, 0.0) : anyTangent(n);
  return glm::vec3(t);
}

/// First corner of the face of each corner in the list; faces of a surface of triangles need no table.
class FaceOf {
 public:
  FaceOf(const Surface& s, const Mesh& mesh) {
    if (!mesh.hasQuads() && s.faceSizes.size() * 3 == s.indices.size()) return;
    if (s.faceSizes.empty()) return;
    for (const std::uint8_t size : s.faceSizes) {
      starts_.push_back(starts_.empty() ? 0 : starts_.back() + last_);
      last_ = size;
    }
    starts_.push_back(starts_.back() + last_);
  }
  std::pair<std::uint32_t, std::uint32_t> of(std::uint32_t corner) const {
    if (starts_.empty()) return {corner / 3 * 3, corner / 3 * 3 + 3};
    const auto next = std::ranges::upper_bound(starts_, corner);
    return {*(next - 1), *next};
  }

 private:
  std::vector<std::uint32_t> starts_;
  std::uint32_t last_ = 0;
};

}  // namespace

std::vector<MendedCorner> mendAll(const Surface& surface, const Mesh& mesh, const Frames& frames, const Output& output,
                                  std::vector<Bad> bad, const Loop& loop) {
  std::ranges::sort(bad, {}, &Bad::corner);
  const FaceOf faces(surface, mesh);
  std::vector<float> determinant(bad.size());
  // Neighbours are looked at before any of them is mended: the outcome does not depend on the order.
  pieces(loop, bad.size(), kGrain, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      const Bad& b = bad[i];
      float d = output.determinant(b.corner);
      const auto [from, to] = faces.of(b.corner);
      for (std::uint32_t c = from; c < to && d == 0.0f; ++c) d = output.determinant(c);
      const bool hasFrame = b.triangle != kNoTriangle && !(frames.of[b.triangle].flags & (kFrameless | kDegenerate));
      if (d == 0.0f) d = hasFrame ? output.determinantOf(frames.of[b.triangle].flags) : 1.0f;
      determinant[i] = d;
    }
  });
  std::vector<MendedCorner> mended(bad.size());
  pieces(loop, bad.size(), kGrain, [&](std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) {
      const Bad& b = bad[i];
      const bool hasFrame = b.triangle != kNoTriangle && !(frames.of[b.triangle].flags & (kFrameless | kDegenerate));
      const glm::dvec3 old(b.why == Mend::NoFrame ? glm::vec3(0.0f) : output.tangent(b.corner));
      Derivatives own;
      if (hasFrame) own = derivativesOf(mesh, b.triangle);
      const glm::dvec3 normal(mesh.vertices[b.id].normal);
      const double sign = output.determinantOf(kPreserving) * determinant[i];
      output.write(b.corner, mendedTangent(normal, old, hasFrame ? &own : nullptr, sign), determinant[i]);
      mended[i] = {b.corner, b.why};
    }
  });
  return mended;
}

}  // namespace lmc::tangent
