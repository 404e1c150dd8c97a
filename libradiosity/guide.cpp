#include "libradiosity/guide.h"

#include <algorithm>
#include <cmath>

namespace lmc {

namespace {
constexpr double kLeastGain = 2.0;  // in variance
}

void Guide::build() {
  // The density of least variance goes with the root of the mean square. Neighbours lend each other a part: few rays have found anything.
  std::array<double, kSide * kSide> share{};
  double sum = 0.0;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      double blurred = 0.0, weights = 0.0;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          if (x + dx < 0 || x + dx >= kSide || y + dy < 0 || y + dy >= kSide) continue;
          const double w = (dx == 0 ? 2.0 : 1.0) * (dy == 0 ? 2.0 : 1.0);
          blurred += w * double(squares_[std::size_t((y + dy) * kSide + x + dx)]);
          weights += w;
        }
      share[std::size_t(y * kSide + x)] = std::sqrt(blurred / weights);
      sum += share[std::size_t(y * kSide + x)];
    }
  built_ = false;
  if (!(sum > 0.0)) return;
  constexpr double kEven = double(kBlind) / (kSide * kSide);
  double even = 0.0, guided = 0.0;  // second moments, of one ray
  for (std::size_t c = 0; c < share.size(); ++c) {
    const double square = double(squares_[c]) / double(rays_), q = kEven + (1.0 - double(kBlind)) * share[c] / sum;
    even += square;
    guided += square / (kSide * kSide * q);
  }
  const double mean = double(sum_) / double(rays_);
  if (even - mean * mean < kLeastGain * (guided - mean * mean)) return;
  built_ = true;
  double column = 0.0;
  for (int x = 0; x < kSide; ++x) {
    columns_[std::size_t(x)] = float(column);
    double inColumn = 0.0;
    for (int y = 0; y < kSide; ++y) inColumn += kEven + (1.0 - double(kBlind)) * share[std::size_t(y * kSide + x)] / sum;
    float* rows = rows_.data() + x * (kSide + 1);
    double row = 0.0;
    for (int y = 0; y < kSide; ++y) {
      rows[y] = float(row);
      row += (kEven + (1.0 - double(kBlind)) * share[std::size_t(y * kSide + x)] / sum) / inColumn;
    }
    rows[kSide] = 1.0f;
    column += inColumn;
  }
  columns_[kSide] = 1.0f;
}

}  // namespace lmc
