// SPDX-License-Identifier: Apache-2.0
//
// The summary of a calibration for the terminal.
#pragma once

#include <string>
#include <vector>

#include "calib/estimate/calibrate.h"

namespace plenocal {

/// A calibration as text for the terminal: per camera the reprojection error, the parameters with
/// their standard errors and the extrinsics, then the refined target. Needs no observations. Ends
/// in a newline.
std::string Summary(const Calibration& calibration);

}  // namespace plenocal
