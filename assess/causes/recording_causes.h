// SPDX-License-Identifier: Apache-2.0
//
// Mistakes of a recording, found in its residuals and poses (docs/diagnosis.md).
#pragma once

#include <vector>

#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// Frames of a camera that are the same image.
std::vector<Finding> FindRepeatedImages(const Calibration& calibration);

/// Which mistakes of the recording the residuals show: focus or zoom that changed, a rolling
/// shutter, single images that disagree with all others. Tests have a false-alarm rate of 1e-3 a
/// camera.
std::vector<Finding> FindRecordingCauses(const Calibration& calibration);

}  // namespace plenocal
