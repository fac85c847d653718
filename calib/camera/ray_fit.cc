// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/ray_fit.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <set>

#include "calib/camera/rays.h"

namespace plenocal {
namespace {

// All image points with their directions as the sum of squares of the model's own projection.
class DirectionCost : public ceres::CostFunction {
 public:
  DirectionCost(const CameraModel& model,
                std::span<const double> config,
                const std::vector<Eigen::Vector3d>& directions,
                const std::vector<Eigen::Vector2d>& image,
                bool within_bounds)
      : model_(model),
        config_(config),
        directions_(directions),
        image_(image),
        within_bounds_(within_bounds) {
    set_num_residuals(static_cast<int>(2 * image.size()));
    mutable_parameter_block_sizes()->push_back(static_cast<int>(model.params.size()));
  }

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override {
    if (within_bounds_ && !WithinBounds(model_, parameters[0])) return false;
    // Point by point and row by row, as Ceres has residuals and derivatives.
    ProjectPoints(model_,
                  parameters[0],
                  config_.data(),
                  {.count = image_.size(), .p = directions_.data()->data()},
                  {.predicted = residuals, .J_params = jacobians ? jacobians[0] : nullptr});
    Eigen::Map<Eigen::Matrix2Xd> difference(residuals, 2, std::ssize(image_));
    if (!difference.allFinite()) return false;
    for (size_t i = 0; i < image_.size(); ++i) {
      difference.col(static_cast<Eigen::Index>(i)) -= image_[i];
    }
    return true;
  }

 private:
  const CameraModel& model_;
  std::span<const double> config_;
  const std::vector<Eigen::Vector3d>& directions_;
  const std::vector<Eigen::Vector2d>& image_;
  bool within_bounds_;
};

}  // namespace

bool FitToRays(const CameraModel& model,
               std::span<const double> config,
               const std::vector<Eigen::Vector3d>& directions,
               const std::vector<Eigen::Vector2d>& image,
               const RayFitOptions& options,
               std::vector<double>* params) {
  std::vector<Eigen::Vector3d> imaged_directions;
  std::vector<Eigen::Vector2d> imaged;
  std::vector<Eigen::Vector2d> predicted(image.size());
  ProjectPoints(model,
                params->data(),
                config.data(),
                {.count = image.size(), .p = directions.data()->data()},
                {.predicted = predicted.data()->data()});
  for (size_t i = 0; i < image.size(); ++i) {
    if (!predicted[i].allFinite()) continue;
    imaged_directions.push_back(directions[i]);
    imaged.push_back(image[i]);
  }
  const auto count = static_cast<int>(params->size());
  std::set<int> fixed(options.fixed.begin(), options.fixed.end());
  for (int k = 0; k < count; ++k) {
    if (model.params[static_cast<size_t>(k)].fixed == Fixed::kAlways) fixed.insert(k);
  }
  if (fixed.size() == params->size() || imaged.size() < params->size()) return false;

  std::vector<double> fitted = *params;
  ceres::Problem fit;
  fit.AddParameterBlock(
      fitted.data(),
      count,
      fixed.empty() ? nullptr : new ceres::SubsetManifold(count, {fixed.begin(), fixed.end()}));
  fit.AddResidualBlock(
      new DirectionCost(model, config, imaged_directions, imaged, options.within_bounds),
      nullptr,
      fitted.data());
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_QR;
  solver.logging_type = ceres::SILENT;
  solver.max_num_iterations = options.max_iterations;
  solver.function_tolerance = options.tolerance;
  solver.parameter_tolerance = std::min(solver.parameter_tolerance, options.tolerance);
  solver.gradient_tolerance = std::min(solver.gradient_tolerance, options.tolerance);
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &fit, &summary);
  if (!summary.IsSolutionUsable()) return false;
  *params = fitted;
  return true;
}

}  // namespace plenocal
