#pragma once
#include <numbers>

namespace lmc {
inline constexpr double kPi = std::numbers::pi;
}  // namespace lmc
