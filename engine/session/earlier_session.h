// SPDX-License-Identifier: Apache-2.0
//
// The earlier calibrations that a session builds on.
#pragma once

#include <vector>

#include "calib/base/run.h"
#include "calib/estimate/calibrate.h"
#include "calib/files/session.h"
#include "calib/prior/earlier_cameras.h"
#include "targets/target.h"

namespace plenocal {

/// Reads the earlier calibrations of a session, with the correlations beside each, or files of
/// other tools; the cameras take their values from them. `cameras`: with observations, in the
/// session's order. Throws `Error` of kind kInput.
EarlierCameras ReadEarlierCameras(const Session& session,
                                  std::vector<CameraInput> cameras,
                                  OpenParams open);

/// The calibration problem of a session with a target and what it has of earlier calibrations.
struct BuiltOnEarlier {
  CalibrationInput input;
  /// Findings about parameters that keep the earlier values: standard errors leave theirs out.
  std::vector<Finding> held;
};
/// As `MakeCalibrationInput`. Throws likewise.
BuiltOnEarlier MakeInputOnEarlier(const Session& session,
                                  const Target& target,
                                  std::vector<CameraInput> cameras,
                                  const Run& run);

}  // namespace plenocal
