// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "calib/base/run.h"
#include "calib/estimate/calibrate.h"
#include "calib/files/session.h"
#include "targets/target.h"

namespace plenocal {

/// Standard deviation of the prior of a refined target's marker coordinates, m: its tolerance, or
/// 1 % of the markers' spacing, that of a laser printer and a hard board.
double RefinedMarkerSigma(const Target& target);

/// The calibration problem of a session and its observations. Prints whether and how the target's
/// markers are refined where session and target leave it open.
CalibrationInput MakeCalibrationInput(const Session& session,
                                      const Target& target,
                                      std::vector<CameraInput> cameras,
                                      const Run& run);

}  // namespace plenocal
