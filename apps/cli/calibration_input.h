// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "apps/cli/console.h"
#include "calib/calibrate.h"
#include "calib/files/session.h"
#include "targets/target.h"

namespace plenocal {

/// The calibration problem of a session and its observations. Prints whether and how the target's
/// markers are refined where session and target leave it open.
CalibrationInput MakeCalibrationInput(const Session& session,
                                      const Target& target,
                                      std::vector<CameraInput> cameras,
                                      Console* console);

/// Standard deviation of marker coordinates where a target states no tolerance and is refined all
/// the same, m: that of a laser printer and a hard board.
double UsualMarkerSigma(const Target& target);

}  // namespace plenocal
