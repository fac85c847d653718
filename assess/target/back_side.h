// SPDX-License-Identifier: Apache-2.0
//
// Images that show the printed side of a target from behind: they are mirrored.
#pragma once

#include <vector>

#include "calib/camera/target_hypothesis.h"
#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// The mirror image of a plane is the plane seen from behind, with the same residuals; only the
/// side differs. One finding for each camera that sees the markers from behind in nearly all views.
std::vector<Finding> FindMirroredImages(const Calibration& calibration, const TargetDoubts& doubts);

}  // namespace plenocal
