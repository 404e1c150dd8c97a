#include "libradiosity/seam_solve.h"

#include <ceres/dynamic_cost_function.h>
#include <ceres/problem.h>
#include <ceres/sized_cost_function.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>

#include "libscene/float_traps.h"

namespace lmc {

namespace {

constexpr int kRounds = 6;  // of solving and putting to limits; the last puts what is left beyond them there

/// (x - value)/sigma
class Stay : public ceres::SizedCostFunction<1, 1> {
 public:
  Stay(double value, double sigma) : value_(value), weight_(1.0 / sigma) {}
  bool Evaluate(double const* const* x, double* residual, double** jacobian) const override {
    residual[0] = weight_ * (x[0][0] - value_);
    if (jacobian && jacobian[0]) jacobian[0][0] = weight_;
    return true;
  }

 private:
  double value_, weight_;
};

/// strength * difference
class Meet : public ceres::DynamicCostFunction {
 public:
  explicit Meet(const SeamEquation& equation) : equation_(equation) {
    for (std::uint32_t k = 0; k < equation.count; ++k) AddParameterBlock(1);
    SetNumResiduals(1);
  }
  bool Evaluate(double const* const* x, double* residual, double** jacobian) const override {
    double sum = equation_.constant;
    for (std::uint32_t k = 0; k < equation_.count; ++k) sum += equation_.weight[k] * x[k][0];
    residual[0] = equation_.strength * sum;
    for (std::uint32_t k = 0; jacobian && k < equation_.count; ++k)
      if (jacobian[k]) jacobian[k][0] = equation_.strength * equation_.weight[k];
    return true;
  }

 private:
  const SeamEquation& equation_;
};

}  // namespace

std::vector<double> solveSeams(const SeamSystem& system) {
  std::vector<double> x = system.value;
  if (x.empty()) return x;
  ceres::Problem::Options owned;
  owned.enable_fast_removal = false;
  ceres::Problem problem(owned);
  for (std::size_t i = 0; i < x.size(); ++i) problem.AddResidualBlock(new Stay(system.value[i], system.sigma[i]), nullptr, &x[i]);
  for (const SeamEquation& e : system.equations) {
    std::vector<double*> blocks;
    for (std::uint32_t k = 0; k < e.count; ++k) blocks.push_back(&x[e.unknown[k]]);
    problem.AddResidualBlock(new Meet(e), nullptr, blocks);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;  // no BLAS, whose sums depend on its threads
  options.num_threads = 1;
  options.max_num_iterations = 1;              // solves a linear system
  options.initial_trust_region_radius = 1e16;  // no damping: the problem is linear
  options.max_solver_time_in_seconds = 1e9;    // a clock must not change a result
  options.function_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
  for (int round = 0; round < kRounds; ++round) {
    ceres::Solver::Summary summary;
    const NoFloatTraps ceres;
    ceres::Solve(options, &problem, &summary);
    bool beyond = false;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double move = x[i] - system.value[i];
      if (std::isfinite(move) && std::abs(move) <= system.limit[i]) continue;
      x[i] = system.value[i] + (std::isfinite(move) ? std::copysign(system.limit[i], move) : 0.0);
      if (!problem.IsParameterBlockConstant(&x[i])) {
        problem.SetParameterBlockConstant(&x[i]);
        beyond = true;
      }
    }
    if (!beyond) break;
  }
  return x;
}

}  // namespace lmc
