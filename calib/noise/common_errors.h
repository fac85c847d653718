// SPDX-License-Identifier: Apache-2.0
//
// Systematic errors that observations share beyond those of one marker in one view, which standard
// errors from independent observations do not contain: per-frame errors (a bent board, motion,
// rolling shutter, focus that moves), which shift the estimate of each frame, and errors of all
// points of a camera.
#pragma once

#include <vector>

#include "calib/noise/uncertainty.h"

namespace plenocal {

/// Scatter of per-frame estimates of one camera's unknowns (parameters and extrinsics).
struct FrameScatter {
  /// Variance of the per-frame estimates over the variance that the noise of their points explains:
  /// 1 where the points of a frame share no error.
  double factor = 1;
  double degrees = 0;  ///< degrees of freedom of `factor` (Satterthwaite's); 0 without information
};

struct CommonErrors {
  /// Per camera. The cluster-robust ("sandwich") covariance (Liang and Zeger, Biometrika 73, 1986),
  /// of which only the mean over all directions is taken: a few frames determine one number well,
  /// but not a matrix.
  std::vector<FrameScatter> scatter;
  /// Covariance of the unknowns from `BundleObservation::shared_errors`.
  Eigen::MatrixXd shared;
};

/// Of a bundle at its optimum, with its own uncertainty.
CommonErrors EstimateCommonErrors(const Bundle& bundle, const Uncertainty& uncertainty);

/// Multiplies the covariance of each camera's unknowns by its factor (an unknown of several cameras
/// takes the largest) and adds `shared`.
void AddCommonErrors(const std::vector<double>& factors,
                     const Eigen::MatrixXd& shared,
                     Uncertainty* uncertainty);

}  // namespace plenocal
