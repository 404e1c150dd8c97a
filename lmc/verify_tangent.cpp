#include "lmc/verify_tangent.h"

#include <fmt/format.h>

#include <cmath>

namespace lmc {

namespace {

constexpr std::size_t kNamed = 10;                    // wrong corners that are told of
constexpr std::uint8_t kNotFinite = 9, kEither = 10;  // ambiguity codes
constexpr float kUnit = 1e-5f, kOrthogonal = 1e-3f;

std::string textOf(glm::vec3 t, float sign) { return fmt::format("({:.9g} {:.9g} {:.9g}) {:+g}", t.x, t.y, t.z, sign); }

void add(TangentVerdict& verdict, std::size_t corner, std::string what) {
  ++verdict.wrong;
  if (verdict.first.size() < kNamed) verdict.first.push_back({corner, std::move(what)});
}

bool isFinite(glm::vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

/// Whether safe mode may differ from this.
bool mayBeMended(const tangent::ReferenceTangent& exact, glm::vec3 normal) {
  const glm::vec3 t = exact.tangent;
  const bool filler = t == glm::vec3(1.0f, 0.0f, 0.0f) && exact.referenceSign == -1.0f;
  return !isFinite(t) || t == glm::vec3(0.0f) || filler || !(std::abs(glm::dot(t, normal)) <= kOrthogonal);
}

}  // namespace

TangentVerdict judgeExact(const TangentVectors& vectors, const tangent::ReferenceTangents& got) {
  TangentVerdict verdict;
  std::size_t notFinite = 0, either = 0;
  for (std::size_t c = 0; c < vectors.indices.size(); ++c) {
    const glm::vec4 want = vectors.tangents[c];
    const tangent::ReferenceTangent& have = got.corners[c];
    ++verdict.judged;
    notFinite += vectors.ambiguity[c] == kNotFinite;
    either += vectors.ambiguity[c] == kEither;
    const bool right = vectors.ambiguity[c] == kNotFinite || (vectors.ambiguity[c] == kEither && have.referenceSign == want.w) ||
                       (have.tangent == glm::vec3(want) && have.referenceSign == want.w);
    if (!right)
      add(verdict, c, fmt::format("{} is {}, not {}", c, textOf(have.tangent, have.referenceSign), textOf(glm::vec3(want), want.w)));
  }
  verdict.summary = fmt::format("{} of {} corners equal in bits", verdict.judged - verdict.wrong - notFinite - either, verdict.judged);
  if (notFinite > 0) verdict.summary += fmt::format(", {} where the reference is not finite", notFinite);
  if (either > 0) verdict.summary += fmt::format(", {} where it hangs on its sorting and only the sign is judged", either);
  return verdict;
}

TangentVerdict judgeSafe(const TangentVectors& vectors, const tangent::ReferenceTangents& exact, const tangent::Tangents& got) {
  TangentVerdict verdict;
  for (std::size_t c = 0; c < vectors.indices.size(); ++c) {
    const glm::vec3 n = vectors.normals[vectors.indices[c]], t = got.corners[c].tangent;
    const float d = got.corners[c].determinant;
    ++verdict.judged;
    const auto wrong = [&](const char* what) { add(verdict, c, fmt::format("{} is {}: {}", c, textOf(t, d), what)); };
    if (!isFinite(t) || !(std::abs(glm::length(t) - 1.0f) <= kUnit))
      wrong("not a unit vector");
    else if (std::abs(d) != 1.0f)
      wrong("determinant is neither +1 nor -1");
    else if (std::abs(glm::length(n) - 1.0f) < kOrthogonal && !(std::abs(glm::dot(n, t)) <= kOrthogonal))
      wrong("not orthogonal to the normal");
    else if (!mayBeMended(exact.corners[c], n) && (t != exact.corners[c].tangent || d != -exact.corners[c].referenceSign))
      wrong("differs from exact mode without need");
  }
  verdict.summary =
      fmt::format("{} of {} corners fit for a file, {} mended", verdict.judged - verdict.wrong, verdict.judged, got.mended.size());
  return verdict;
}

}  // namespace lmc
