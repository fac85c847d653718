// SPDX-License-Identifier: Apache-2.0
//
// Findings of a calibration that the user should read, in words.
#pragma once

#include <string>
#include <vector>

#include "calib/calibrate.h"

namespace plenocal {

/// The camera's frames scatter `ratio` times more than detection noise explains.
std::string WarningOfSystematicErrors(const std::string& camera, double ratio);

/// All frames show the target from one pose.
std::string WarningOfOnePose(size_t frames);

/// The rig is not rigid or not synchronous; empty when it is.
std::vector<std::string> WarningsOfJitter(const Jitter& jitter);

/// Bounds that the estimate lies on, and priors that the images contradict.
std::vector<std::string> WarningsOfRules(const Calibration& calibration);

}  // namespace plenocal
