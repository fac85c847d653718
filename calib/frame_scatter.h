// SPDX-License-Identifier: Apache-2.0
//
// Whether the frames agree on the cameras as well as independent errors of their points would let
// them. Points of one frame that err together (focus that moves, a detector's bias that follows
// depth or light) leave each frame with a camera of its own, and sigmas that count points too
// small.
#pragma once

#include <vector>

#include "calib/uncertainty.h"

namespace plenocal {

/// Of one camera's unknowns (intrinsics and mount).
struct FrameScatter {
  /// Variance of what single frames ask for, over what the independent errors of their points make
  /// of it: 1 where the points err independently.
  double factor = 1;
  double degrees = 0;  ///< degrees of freedom of `factor` (Satterthwaite's); 0 when nothing tells
};

/// Per camera of a bundle at its optimum, with its own uncertainty. The cluster-robust ("sandwich")
/// covariance (Liang and Zeger, Biometrika 73, 1986), of which only the mean over all directions is
/// taken: a few frames tell one number well, but not a matrix.
std::vector<FrameScatter> ScatterOfFrames(const Bundle& bundle, const Uncertainty& uncertainty);

/// Multiplies the covariance of each camera's unknowns by its factor; an unknown of several cameras
/// takes the largest.
void ScaleCameras(const std::vector<double>& factors, Uncertainty* uncertainty);

}  // namespace plenocal
