// SPDX-License-Identifier: Apache-2.0
//
// Initial extrinsics of the cameras of a rig.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "calib/start/camera_guess.h"

namespace plenocal {

/// Initial T_camera_rig of every camera from the frames that cameras share, along a spanning tree
/// with the most common frames a link, so that chains of overlap suffice.
/// `guesses[i].T_camera_target` belongs to `cameras[i].views`. Throws `Error` of kind kJob that
/// names cameras without a link to the master. `earlier`, per camera or empty, has the extrinsics
/// of an earlier calibration, which place cameras that share no frame.
std::vector<RigidTransform> GuessRig(std::span<const CameraInput> cameras,
                                     std::span<const CameraGuess> guesses,
                                     std::span<const std::optional<RigidTransform>> earlier = {});

}  // namespace plenocal
