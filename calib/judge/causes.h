// SPDX-License-Identifier: Apache-2.0
//
// Causes by name: mistakes of target file, lens model and recording that users really make
// (docs/diagnosis.md).
#pragma once

#include <vector>

#include "calib/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// All causes that a calibration shows by itself.
std::vector<Finding> FindCauses(const Calibration& calibration);

}  // namespace plenocal
