// SPDX-License-Identifier: Apache-2.0
//
// Systematic errors that the points of a frame share (a bent board, motion, rolling shutter, focus
// that moves), and those that the images of a marker share in all frames (its neighbourhood moves
// it in one camera otherwise than in another). They shift the estimate by each frame or marker, and
// standard errors from independent observations do not contain them.
#pragma once

#include <vector>

#include "calib/noise/uncertainty.h"

namespace plenocal {

/// Scatter of estimates of one camera's unknowns (parameters and extrinsics) by single frames, or
/// by single markers.
struct Scatter {
  /// Variance of these estimates over the variance that the noise of their points explains: 1 where
  /// the points of a frame (of a marker) share no error.
  double factor = 1;
  double degrees = 0;  ///< degrees of freedom of `factor` (Satterthwaite's); 0 without information
};

/// Per camera.
struct SystematicScatter {
  std::vector<Scatter> of_frames;
  /// With clusters of all points of a marker. Without estimate for rigs with jitter and for
  /// landmarks.
  std::vector<Scatter> of_markers;
};

/// Estimates the scatter of a bundle at its optimum with its own uncertainty. Of the cluster-robust
/// ("sandwich") covariance (Liang and Zeger, Biometrika 73, 1986) only the mean over all directions
/// is taken: a few frames determine one number well, but not a matrix.
SystematicScatter EstimateScatter(const Bundle& bundle, const Uncertainty& uncertainty);

/// Multiplies the covariance of each camera's unknowns by its factor (an unknown of several cameras
/// takes the largest).
void ScaleByScatter(const std::vector<double>& factors, Uncertainty* uncertainty);

}  // namespace plenocal
