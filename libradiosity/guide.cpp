#include "libradiosity/guide.h"

#include <algorithm>
#include <cmath>

namespace lmc {

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
  built_ = sum > 0.0;
  if (!built_) return;
  constexpr double kEven = double(kBlind) / (kSide * kSide);
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
