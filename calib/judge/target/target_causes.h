// SPDX-License-Identifier: Apache-2.0
//
// What is wrong with the target or its file, by name.
#pragma once

#include <functional>
#include <vector>

#include "calib/calibrate.h"
#include "calib/camera/target_hypothesis.h"
#include "calib/files/finding.h"

namespace plenocal {

/// The causes in the target, worst first: another layout than stated (layout_test.h), two targets
/// with equal numbers, a wrong unit of length, single markers or tags (marker_offsets.h), a bent
/// board (flatness.h). `calibration`: of `input`, null where it has failed; without it only the
/// first two can be tested. `go_on` is asked before each iteration of a second calibration; false
/// stops it (`Stopped` is thrown).
std::vector<Finding> FindTargetCauses(const CalibrationInput& input,
                                      const TargetDoubts& doubts,
                                      const Calibration* calibration,
                                      const std::function<bool()>& go_on);

}  // namespace plenocal
