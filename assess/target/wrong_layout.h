// SPDX-License-Identifier: Apache-2.0
//
// Tests whether the images show another target than the stated one, without a camera calibration.
#pragma once

#include <Eigen/Core>
#include <map>
#include <vector>

#include "calib/camera/target_hypothesis.h"
#include "calib/files/finding.h"
#include "calib/start/camera_guess.h"

namespace plenocal {

/// Each view of a flat target is a smooth map of its plane to the image (`PlaneMap`), whatever the
/// lens (of strong distortions the most fitting one of a few is taken off first); the residuals of
/// this map have the size of the noise for the target that is in the images, and that of the
/// mistake for all others. The hypothesis with the smallest residuals is named when they explain
/// more than half of the variance that the stated target leaves, when an F-test of these variances
/// would accept such a ratio less than once in a million, and when they themselves are small
/// compared with the spacing of the points. Variances are robust: by a quantile of the squared
/// lengths.
///
/// A target whose markers lie in no plane is tested by the initial guess of a camera instead, for
/// each hypothesis. Returns one finding or none.
std::vector<Finding> FindWrongLayout(const std::vector<CameraInput>& cameras,
                                     const std::map<int, Eigen::Vector3d>& markers,
                                     const TargetDoubts& doubts);

/// Two targets with equal numbers in one image: the points follow two smooth maps. One finding or
/// none; of flat targets only.
std::vector<Finding> FindTargetTwice(const std::vector<CameraInput>& cameras,
                                     const std::map<int, Eigen::Vector3d>& markers);

}  // namespace plenocal
