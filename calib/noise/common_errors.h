// SPDX-License-Identifier: Apache-2.0
//
// Errors that observations share beyond those of one marker in one view, which sigmas by rows do
// not know of: those of all points of a frame (focus that moves, a detector's bias that follows
// depth or light), which leave each frame with a camera of its own, and those of all points of a
// camera.
#pragma once

#include <vector>

#include "calib/uncertainty.h"

namespace plenocal {

/// Of one camera's unknowns (intrinsics and mount).
struct FrameScatter {
  /// Variance of what single frames ask for, over what the noise of their points makes of it: 1
  /// where the points of a frame share no error.
  double factor = 1;
  double degrees = 0;  ///< degrees of freedom of `factor` (Satterthwaite's); 0 when nothing tells
};

struct CommonErrors {
  /// Per camera. The cluster-robust ("sandwich") covariance (Liang and Zeger, Biometrika 73, 1986),
  /// of which only the mean over all directions is taken: a few frames tell one number well, but
  /// not a matrix.
  std::vector<FrameScatter> scatter;
  /// What `BundleObservation::shared_errors` add to the covariance of the unknowns.
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
