// SPDX-License-Identifier: Apache-2.0
//
// What is wrong with the target or its file, by name.
#pragma once

#include <vector>

#include "calib/camera/target_hypothesis.h"
#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

/// The causes in the target, worst first: another layout than stated (layout_test.h), two targets
/// with equal numbers, a wrong unit of length, single markers or tags (marker_offsets.h).
/// `calibration`: of `input`, null where it has failed; without it only the first two can be
/// tested. Whether a board is bent is for `Diagnose`: a wrong lens model looks like it.
std::vector<Finding> FindTargetCauses(const CalibrationInput& input,
                                      const TargetDoubts& doubts,
                                      const Calibration* calibration);

}  // namespace plenocal
