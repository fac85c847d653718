// SPDX-License-Identifier: Apache-2.0
//
// Why the cameras of a rig disagree about the pose of the target (docs/diagnosis.md).
#pragma once

#include <vector>

#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// Of a rig whose frames disagree (`Jitter`): images paired wrongly by a constant number of frames,
/// cameras that move on the rig, or else images taken at different times. Empty for others.
std::vector<Finding> FindRigCauses(const Calibration& calibration);

}  // namespace plenocal
