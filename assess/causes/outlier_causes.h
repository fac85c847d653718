// SPDX-License-Identifier: Apache-2.0
//
// Images, markers and points that disagree with all others in a way that has a name
// (docs/diagnosis.md).
#pragma once

#include <vector>

#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// Images that agree with the others after a rotation by 180 degrees, markers most of whose points
/// were rejected, and worse points along the image's border. The tests have a false-alarm rate of
/// 1e-4 a camera.
std::vector<Finding> FindOutlierCauses(const Calibration& calibration);

}  // namespace plenocal
