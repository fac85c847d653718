// SPDX-License-Identifier: Apache-2.0
//
// Gaussian priors as residuals in sigmas.
#pragma once

#include <ceres/sized_cost_function.h>

#include <span>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/adjust/parameter_blocks.h"

namespace plenocal::internal {

/// (marker - nominal) / sigma for the markers of one block; a last block may have spare ones.
class MarkerPrior : public ceres::CostFunction {
 public:
  MarkerPrior(std::span<const double> nominal, size_t block_size, double sigma);
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

/// (|a - b| - length) / sigma for two landmarks.
class DistanceCost : public ceres::SizedCostFunction<1, 3, 3> {
 public:
  explicit DistanceCost(const MarkerDistance& distance) : distance_(distance) {}
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  MarkerDistance distance_;
};

/// Residual of `CalibrationPrior`. Parameter blocks: those of the unknowns' intrinsics and
/// extrinsics, each once, in the order of `Blocks`.
class CalibrationPriorCost : public ceres::CostFunction {
 public:
  CalibrationPriorCost(const Bundle& bundle, Unknowns* unknowns);
  [[nodiscard]] const std::vector<double*>& Blocks() const { return blocks_; }
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  // Where an unknown of the prior is found: block and slot. Chart of an extrinsics block about the
  // solve's start, in the chart about the prior's pose.
  struct Place {
    size_t block = 0, slot = 0;
    const ChartedPose* pose = nullptr;
  };

  size_t AddBlock(double* values, size_t size);

  const CalibrationPrior& prior_;
  std::vector<double*> blocks_;
  std::vector<Place> places_;
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
