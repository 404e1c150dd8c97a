#pragma once
/// Four floats or words side by side, as GCC and Clang have them on every processor: for moving between one record after the other and one
/// array for each member.
#include <cstdint>
#include <cstring>
#include <glm/glm.hpp>

namespace lmc::tangent {

typedef float Four __attribute__((vector_size(16)));
typedef std::int32_t FourWords __attribute__((vector_size(16)));

inline Four loadFour(const float* p) {
  Four v;
  std::memcpy(&v, p, sizeof v);
  return v;
}
inline void storeFour(float* p, Four v) { std::memcpy(p, &v, sizeof v); }
inline Four smaller(Four a, Four b) { return a < b ? a : b; }
inline Four all(float x) { return Four{x, x, x, x}; }

/// x, y, z and a zero; reads no more than those three.
inline Four loadThree(const glm::vec3& v) { return Four{v.x, v.y, v.z, 0.0f}; }

/// Rows become columns.
inline void transpose(Four& a, Four& b, Four& c, Four& d) {
  const Four ab = __builtin_shufflevector(a, b, 0, 4, 1, 5), cd = __builtin_shufflevector(c, d, 0, 4, 1, 5);
  const Four abHigh = __builtin_shufflevector(a, b, 2, 6, 3, 7), cdHigh = __builtin_shufflevector(c, d, 2, 6, 3, 7);
  a = __builtin_shufflevector(ab, cd, 0, 1, 4, 5);
  b = __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
  c = __builtin_shufflevector(abHigh, cdHigh, 0, 1, 4, 5);
  d = __builtin_shufflevector(abHigh, cdHigh, 2, 3, 6, 7);
}

/// Bit i: word i is not zero. Words are 0 or -1.
inline std::uint32_t bitsOf(FourWords w) {
#ifdef __SSE2__
  return std::uint32_t(__builtin_ia32_movmskps(reinterpret_cast<Four>(w)));
#else
  return (w[0] & 1u) | (w[1] & 2u) | (w[2] & 4u) | (w[3] & 8u);
#endif
}

}  // namespace lmc::tangent
