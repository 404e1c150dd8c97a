#include "lmc/fits.h"

#include <ceres/autodiff_cost_function.h>
#include <ceres/problem.h>
#include <ceres/sized_cost_function.h>
#include <ceres/solver.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <vector>

#include "libradiosity/lights.h"
#include "libscene/float_traps.h"

namespace lmc {

namespace {

constexpr double kDim = 0.01;             // of the mean: what is darker counts as if it were so bright (as rooms do, design.md section 5)
constexpr double kLeastConstant = 1e-12;  // of what the first place asks for: at distance 0 nothing else keeps the light finite
constexpr double kLeastPower = 0.05, kMostPower = 64.0;
// The problem has a valley for each power: the best of these starts counts.
constexpr std::array kPowers{0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 8.0, 16.0, 40.0};

ceres::Solver::Options quietOptions() {
  ceres::Solver::Options o;
  o.linear_solver_type = ceres::DENSE_QR;
  o.num_threads = 1;
  o.max_solver_time_in_seconds = 1e9;  // a clock must not change a result
  o.logging_type = ceres::SILENT;
  o.max_num_iterations = 500;
  o.function_tolerance = 1e-15;
  o.gradient_tolerance = 1e-15;
  o.parameter_tolerance = 1e-12;
  return o;
}

/// (a(d) - wished)/against with t = d/range, so that all four unknowns are of a size: a = scale (1 - t^power)/(c + l t + q t^2).
struct Off {
  double t, wished, against, scale;
  template <class T>
  bool operator()(const T* shape, const T* power, T* residual) const {
    const T below = shape[0] + shape[1] * t + shape[2] * t * t;
    T value(0.0);
    if (t <= 0.0)
      value = scale / below;
    else if (t < 1.0)
      value = scale * (1.0 - pow(T(t), power[0])) / below;
    residual[0] = (value - wished) / against;
    return true;
  }
};

/// Constant, linear and quadratic for a power, none negative, so that the squares of (wished D - window)/against are least: linear in all
/// three, and near to what is wanted where the fit is near. All subsets are tried; the others are 0.
std::array<double, 3> startFor(double power, std::span<const FallOffPlace> wished, double range_m, double least, double scale) {
  std::array<double, 3> best{1.0, 0.0, 0.0};
  double bestSquares = INFINITY;
  for (int subset = 1; subset < 8; ++subset) {
    glm::dmat3 normal(0.0);
    glm::dvec3 right(0.0);
    const auto rowOf = [&](const FallOffPlace& p, glm::dvec3& row, double& wish) {
      const double t = p.distance_m / range_m, against = std::max(p.value, least);
      row = glm::dvec3(1.0, t, t * t) * (p.value / against);
      for (int k = 0; k < 3; ++k)
        if (!(subset >> k & 1)) row[k] = 0.0;
      wish = scale * std::max(0.0, 1.0 - std::pow(t, power)) / against;
    };
    glm::dvec3 row;
    double wish = 0.0;
    for (const FallOffPlace& p : wished) {
      rowOf(p, row, wish);
      normal += glm::outerProduct(row, row);
      right += wish * row;
    }
    for (int k = 0; k < 3; ++k)
      if (!(subset >> k & 1)) normal[k][k] = 1.0;
    const glm::dvec3 x = glm::inverse(normal) * right;
    if (!(x.x >= 0.0 && x.y >= 0.0 && x.z >= 0.0 && x.x + x.y + x.z > 0.0)) continue;
    double squares = 0.0;
    for (const FallOffPlace& p : wished) {
      rowOf(p, row, wish);
      squares += std::pow(glm::dot(row, x) - wish, 2.0);
    }
    if (squares < bestSquares) {
      bestSquares = squares;
      best = {x.x, x.y, x.z};
    }
  }
  return best;
}

double againstOf(std::span<const FallOffPlace> wished) {
  double mean = 0.0;
  for (const FallOffPlace& p : wished) mean += p.value / double(wished.size());
  return kDim * mean;
}

/// x log-linear: residual log y - (b + m log x).
class OffLine : public ceres::SizedCostFunction<1, 2> {
 public:
  OffLine(double x, double y) : x_(std::log(x)), y_(std::log(y)) {}
  bool Evaluate(double const* const* line, double* residual, double** jacobian) const override {
    residual[0] = y_ - (line[0][0] + line[0][1] * x_);
    if (jacobian && jacobian[0]) {
      jacobian[0][0] = -1.0;
      jacobian[0][1] = -x_;
    }
    return true;
  }

 private:
  double x_, y_;
};

}  // namespace

AttenuationFit fitAttenuation(std::span<const FallOffPlace> wished, double range_m) {
  assert(wished.size() >= 4 && range_m > 0.0);
  const double least = againstOf(wished), scale = wished[0].value;
  double best = INFINITY;
  AttenuationFit out;
  for (const double start : kPowers) {
    std::array<double, 3> shape = startFor(start, wished, range_m, least, scale);
    double power = start;
    shape[0] = std::max(shape[0], kLeastConstant);
    ceres::Problem problem;
    for (const FallOffPlace& p : wished)
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<Off, 1, 3, 1>(new Off{p.distance_m / range_m, p.value, std::max(p.value, least), scale}), nullptr,
          shape.data(), &power);
    for (int k = 0; k < 3; ++k) problem.SetParameterLowerBound(shape.data(), k, k == 0 ? kLeastConstant : 0.0);
    problem.SetParameterLowerBound(&power, 0, kLeastPower);
    problem.SetParameterUpperBound(&power, 0, kMostPower);
    ceres::Solver::Summary summary;
    const NoFloatTraps ceres;
    ceres::Solve(quietOptions(), &problem, &summary);
    if (!summary.IsSolutionUsable() || !(summary.final_cost < best)) continue;
    best = summary.final_cost;
    if (shape[0] < 2.0 * kLeastConstant) shape[0] = 0.0;
    out.attenuation = {shape[0] / scale, shape[1] / (scale * range_m), shape[2] / (scale * range_m * range_m), range_m, power};
  }
  double squares = 0.0;
  for (const FallOffPlace& p : wished) {
    const double off = attenuation(out.attenuation, p.distance_m) - p.value, relative = std::abs(off) / std::max(p.value, least);
    squares += relative * relative;
    if (relative <= out.largest) continue;
    out.largest = relative;
    out.largestAt_m = p.distance_m;
    out.largestValue = off;
  }
  out.rms = std::sqrt(squares / double(wished.size()));
  return out;
}

std::optional<PowerLaw> fitPowerLaw(std::span<const CurvePoint> points) {
  ceres::Problem problem;
  std::array<double, 2> line{0.0, 0.0};
  std::vector<double> x;
  for (const CurvePoint& p : points) {
    if (!(p.x > 0.0) || !(p.y > 0.0)) continue;
    problem.AddResidualBlock(new OffLine(p.x, p.y), nullptr, line.data());
    x.push_back(std::log(p.x));
  }
  if (x.size() < 2 || std::ranges::max(x) - std::ranges::min(x) < 1e-9) return std::nullopt;
  ceres::Solver::Summary summary;
  ceres::Solver::Options options = quietOptions();
  options.initial_trust_region_radius = 1e16;  // no damping: the problem is linear
  const NoFloatTraps ceres;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return std::nullopt;
  const double n = double(x.size());
  double mean = 0.0, spread = 0.0;
  for (const double v : x) mean += v / n;
  for (const double v : x) spread += (v - mean) * (v - mean);
  // Standard error of a slope: s^2 = sum of squares/(n - 2), var = s^2/sum (x - mean)^2.
  const double squares = 2.0 * summary.final_cost;
  return PowerLaw{std::exp(line[0]), line[1], n > 2.0 ? std::sqrt(squares / (n - 2.0) / spread) : 0.0, std::sqrt(squares / n)};
}

}  // namespace lmc
