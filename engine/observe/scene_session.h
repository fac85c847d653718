// SPDX-License-Identifier: Apache-2.0
//
// Sessions with a scene in place of a target.
#pragma once

#include <vector>

#include "calib/files/session.h"
#include "engine/scene/scene_calibration.h"

namespace plenocal {

/// Throws `Error` of kind kInput for what such a session does not support.
void CheckSceneSession(const Session& session, bool jackknife);

/// With the earlier calibration of the session, which is read here. `cameras`: with observations,
/// in the session's order.
SceneCalibrationInput MakeSceneInput(const Session& session, std::vector<CameraInput> cameras);

}  // namespace plenocal
