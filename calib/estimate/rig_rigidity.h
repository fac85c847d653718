// SPDX-License-Identifier: Apache-2.0
//
// Tests whether a rig is rigid and its frames are synchronous; jitter of the views where they are
// not.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/noise/uncertainty.h"
#include "calib/start/camera_guess.h"

namespace plenocal {

/// Tests whether the views of a frame agree on one pose within their noise: an F-test of
/// the gain by poses of their own, where that is more than half of some camera's residuals (less is
/// no worse than other errors of the model). Of a bundle at its optimum. `typical_sigmas` per
/// camera.
bool FramesAgree(const Bundle& bundle,
                 const Uncertainty& uncertainty,
                 std::span<const double> typical_sigmas);

/// Jitter from the poses that each camera found alone (`guesses`, parallel to `cameras`).
/// `frames`: names of the bundle's frames.
void StartJitter(std::span<const CameraInput> cameras,
                 std::span<const CameraGuess> guesses,
                 const std::vector<std::string>& frames,
                 Bundle* bundle);

/// Sigmas of the jitter from its estimates, and which views are misplaced; nothing for a rigid,
/// synchronous rig. Returns the largest relative change.
double UpdateJitter(const Uncertainty& uncertainty, Bundle* bundle);

}  // namespace plenocal
