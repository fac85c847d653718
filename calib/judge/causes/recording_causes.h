// SPDX-License-Identifier: Apache-2.0
//
// Mistakes of a recording, found in its residuals and poses (docs/diagnosis.md).
#pragma once

#include <vector>

#include "calib/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// Which mistakes of the recording the calibration shows: the same image twice, focus or zoom that
/// changed, a rolling shutter, single images that disagree with all others; of a rig frames that
/// belong to different instants. Each by a significance test whose false-alarm rate is 1e-3 a
/// camera.
std::vector<Finding> FindRecordingCauses(const Calibration& calibration);

}  // namespace plenocal
