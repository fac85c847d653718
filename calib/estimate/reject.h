// SPDX-License-Identifier: Apache-2.0
//
// Choice of the observations that take part in the bundle adjustment.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal {

/// Fewest markers from which a frame's pose follows.
inline constexpr size_t kMinMarkersInFrame = 4;

/// Expected number of good observations that are rejected in one calibration; also of good views
/// that are taken as misplaced.
inline constexpr double kFalseRejections = 0.05;

struct Rejection {
  size_t changed = 0;    ///< observations taken out or back
  double threshold = 0;  ///< largest length of a used weighted residual, sigmas
};

/// Applies the rejection rule of `Calibrate` with the present noise. A view most of whose points
/// are outliers is rejected as a whole (a moved target, a false pose).
Rejection RejectOutliers(Bundle* bundle);

/// Uses exactly the observations of the chosen frames that project.
void UseProjecting(const std::vector<bool>& frames, Bundle* bundle);

/// Leaves out frames that rejection left with too few markers for a pose.
void DropWeakFrames(Bundle* bundle);

/// Rejects observations as `RejectOutliers` does, then the landmarks whose observations contradict
/// each other (points that move, wrong matches: more than a third are rejected) and those whose
/// depth their observations do not determine. Landmarks that did not take part are estimated first,
/// so that they can come back.
Rejection RejectLandmarks(Bundle* bundle);

/// Up to `limit` frames of each camera, spread over the recording.
std::vector<bool> SelectFrames(const Bundle& bundle, size_t limit);

/// Throws `Error` of kind kJob for a camera without used observations.
void CheckAllCamerasUsed(const Bundle& bundle);

}  // namespace plenocal
