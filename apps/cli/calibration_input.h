// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "apps/console.h"
#include "calib/calibrate.h"
#include "calib/session.h"
#include "targets/target.h"

namespace plenocal {

/// What a session asks to be calibrated from these observations. Tells `console` how the target's
/// markers are taken where session and target do not say.
CalibrationInput MakeCalibrationInput(const Session& session,
                                      const Target& target,
                                      std::vector<CameraInput> cameras,
                                      Console* console);

}  // namespace plenocal
