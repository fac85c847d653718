// SPDX-License-Identifier: Apache-2.0
//
// A part of a recording, on which tests take as long for a thousand frames as for sixty, and for a
// thousand markers as for five hundred.
#pragma once

#include <vector>

#include "calib/estimate/calibrate.h"

namespace plenocal {

/// The cameras with every k-th frame, at most as many as the tests need.
std::vector<CameraInput> ChooseFrames(const std::vector<CameraInput>& cameras);

/// A calibration with every k-th frame; poses and noise are those of all frames, `uncertainty` too.
Calibration ChooseFrames(const Calibration& calibration);

/// The calibration of a target of many markers with every k-th of those that were observed.
Calibration ChooseMarkers(Calibration calibration);

}  // namespace plenocal
