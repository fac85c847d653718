// SPDX-License-Identifier: Apache-2.0
//
// Gaussian priors as residuals in sigmas.
#pragma once

#include <ceres/cost_function.h>

#include <functional>
#include <span>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/adjust/solver/parameter_blocks.h"

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

/// (sum of weight * parameter - value) / sigma for parameters of a block of `size`.
class ParamPriorCost : public ceres::CostFunction {
 public:
  ParamPriorCost(size_t size, SlotPrior prior);
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  size_t size_;
  SlotPrior prior_;
};

/// Distances of one of `Bundle::DistanceGroups`: residual L^-1 (|a - b| - length), L L' their
/// covariance.
class DistanceRows {
 public:
  explicit DistanceRows(std::vector<MarkerDistance> distances);
  /// Indices of the landmarks, ascending.
  [[nodiscard]] const std::vector<int>& Markers() const { return markers_; }
  [[nodiscard]] Eigen::Index Rows() const { return weight_.rows(); }
  /// Sets the residual and its derivatives (rows x 3 a landmark) at the positions of `Markers`, in
  /// their order; false where both ends of one coincide.
  bool Evaluate(std::span<const Eigen::Vector3d> positions,
                Eigen::VectorXd* residual,
                Eigen::MatrixXd* J) const;

 private:
  std::vector<MarkerDistance> distances_;
  std::vector<int> markers_;
  Eigen::MatrixXd weight_;  // L^-1
};

/// The rows of the bundle's distances between landmarks that are all `used`.
std::vector<DistanceRows> RowsOfDistances(const Bundle& bundle,
                                          const std::function<bool(int marker)>& used);

/// `DistanceRows` with a parameter block for each of its landmarks.
class DistanceCost : public ceres::CostFunction {
 public:
  explicit DistanceCost(DistanceRows rows);
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  DistanceRows rows_;
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
  // Block and slot of an unknown of the prior. Chart of an extrinsics block about the
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
