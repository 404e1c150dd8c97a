#pragma once
/// Angles whose cosines are single precision, many at a time: the float next to acos in double precision, as the reference has it.
#include <cmath>

#include "libtangent/simd.h"

namespace lmc::tangent {

namespace angle {
// asin(x) / x as a polynomial in x^2 over [0, 1/4]: Chebyshev interpolation, relative error 6.3e-14.
inline constexpr double kAsin[] = {0.9999999999999493,     0.16666666670723188,  0.07499999467531561,  0.044643126897073435,
                                   0.030375046838709736,   0.022472629272259407, 0.016472738109361944, 0.018638508213446328,
                                   -0.0028563505336838967, 0.03194399638410843};
/// More than what the polynomial and its rounding are off by: results so near to the middle of two floats are left to std::acos.
inline constexpr double kDoubt = 1e-12;
inline constexpr double kPi = 3.14159265358979323846;
}  // namespace angle

/// angle[i] = (float)acos((double)cosine[i]) for cosines in [-1, 1] or NaN. doubt[i] != 0: it is one of the two next floats, ask std::acos.
LMC_INLINE void angles(const float* cosine, float* out, unsigned* doubt, int count) {
  using namespace angle;
  for (int i = 0; i < count; ++i) {
    // acos(x) = pi/2 - asin(x) where |x| <= 1/2, else 2 asin(sqrt((1 - |x|)/2)), or pi minus that.
    const double x = double(cosine[i]), a = std::abs(x);
    const bool inner = a <= 0.5;
    const double z = inner ? x * x : 0.5 - 0.5 * a;
    const double root = std::sqrt(z);
    const double r = inner ? x : root;
    const double p =
        kAsin[0] +
        z * (kAsin[1] +
             z * (kAsin[2] +
                  z * (kAsin[3] + z * (kAsin[4] + z * (kAsin[5] + z * (kAsin[6] + z * (kAsin[7] + z * (kAsin[8] + z * kAsin[9]))))))));
    const double asin = r * p;
    const double outer = x > 0.0 ? 2.0 * asin : kPi - 2.0 * asin;
    const double y = inner ? 0.5 * kPi - asin : outer;
    const float low = float(y * (1.0 - kDoubt)), high = float(y * (1.0 + kDoubt));
    out[i] = low;
    doubt[i] = low != high;  // of NaN, too
  }
}

}  // namespace lmc::tangent
