// SPDX-License-Identifier: Apache-2.0
//
// Gaussian priors as residuals in sigmas.
#pragma once

#include <ceres/cost_function.h>

#include <span>
#include <vector>

#include "calib/camera/param_rule.h"
#include "calib/camera/rigid_transform.h"

namespace plenocal::internal {

/// (marker - nominal) / sigma for the markers of one block; a last block may have spare ones.
class MarkerPrior : public ceres::CostFunction {
 public:
  MarkerPrior(std::span<const double> nominal, double sigma);
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  std::vector<double> nominal_;
  double sigma_;
};

/// (parameter - value) / sigma for the parameter at `slot` of a block of `size`.
class ParamPrior : public ceres::CostFunction {
 public:
  ParamPrior(size_t size, size_t slot, ParamRule::Prior prior);
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  size_t size_;
  size_t slot_;
  ParamRule::Prior prior_;
};

/// W delta of one view's jitter (`JitterWeight`).
class JitterPrior : public ceres::CostFunction {
 public:
  explicit JitterPrior(const Matrix6d& weight);
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  Matrix6d weight_;
};

}  // namespace plenocal::internal
