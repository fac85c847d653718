// SPDX-License-Identifier: Apache-2.0
//
// Target poses estimated one frame or one view at a time, all else fixed.
#pragma once

#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal {

/// Moves T_rig_target of the chosen frames to the optimum of their used observations while all else
/// stays: a few robust Gauss-Newton steps from a pose that is nearly right. Much cheaper than
/// `Adjust`.
void AdjustPoses(Bundle* bundle, const std::vector<bool>& frames);

/// The pose of one frame, whose observations are [begin, end).
void AdjustPose(size_t begin, size_t end, Bundle* bundle);

/// Information of the used observations in [begin, end), of one frame, on its pose in its chart.
Matrix6d PoseInformation(const Bundle& bundle, size_t begin, size_t end);

/// Step of the target's pose to the optimum of one view alone.
struct PoseStep {
  int frame = 0, camera = 0;
  Vector6d delta;   ///< in the chart of the view's pose
  double gain = 0;  ///< by how much the step lowers the view's sum of squares, sigma^2
};
/// The pose from every view that has used observations enough for a pose, in their order.
std::vector<PoseStep> OwnPoseSteps(const Bundle& bundle);

}  // namespace plenocal
