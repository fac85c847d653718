// SPDX-License-Identifier: Apache-2.0
//
// Priors of cameras' parameters and extrinsics, and measured distances, as rows of the adjustment.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "calib/adjust/layout.h"

namespace plenocal::internal {

/// A prior's residual in standard deviations at the bundle's present values, with its derivatives
/// by unknowns of a layout, in the charts about these values.
struct SparseRow {
  std::vector<std::pair<int, double>> J;  ///< index of an unknown, derivative
  double residual = 0;
};

/// Priors of parameters (`ParamPriors`) of which one at least is in `layout`.
std::vector<SparseRow> RowsOfParamPriors(const BundleState& bundle, const UnknownLayout& layout);
/// The earlier calibration (`CalibrationPrior`), if there is one.
std::vector<SparseRow> RowsOfCalibrationPrior(const BundleState& bundle,
                                              const UnknownLayout& layout);

/// Adds J' J to the lower triangle of `information`.
void AddInformation(const std::vector<SparseRow>& rows, Eigen::MatrixXd* information);

/// Derivative of component `component` of a pose in the chart about `origin` by the chart about its
/// present value `T`.
Vector6d ChartDerivative(const RigidTransform& origin,
                         const RigidTransform& T,
                         Eigen::Index component);

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

}  // namespace plenocal::internal
