// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "calib/start.h"

namespace plenocal {

/// Initial T_camera_rig of every camera from the frames that cameras share, along a spanning tree
/// with the most common frames a link, so that chains of overlap suffice.
/// `guesses[i].T_camera_target` belongs to `cameras[i].views`. Throws `Error` of kind kJob that
/// names cameras without a link to the master.
std::vector<RigidTransform> GuessRig(std::span<const CameraInput> cameras,
                                     std::span<const CameraGuess> guesses);

}  // namespace plenocal
