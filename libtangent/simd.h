#pragma once
/// Loops over arrays are compiled twice, for any x86-64 and for AVX2; the processor decides which runs. The bits are the same: each lane
/// does one rounding per operation, and contraction is off (tests/libtangent pins both).

#define LMC_INLINE inline __attribute__((always_inline))

#if defined(__x86_64__) && defined(__GNUC__)
#define LMC_AVX2 __attribute__((target("avx2")))
namespace lmc::tangent {
inline bool hasAvx2() {
  static const bool has = __builtin_cpu_supports("avx2");
  return has;
}
}  // namespace lmc::tangent
#else
#define LMC_AVX2
namespace lmc::tangent {
inline constexpr bool hasAvx2() { return false; }
}  // namespace lmc::tangent
#endif
