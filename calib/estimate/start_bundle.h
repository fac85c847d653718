// SPDX-License-Identifier: Apache-2.0
//
// Initial guess of a whole calibration: cameras, extrinsics, one pose a frame, and the observations
// that take part.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/estimate/fit.h"
#include "calib/files/finding.h"
#include "calib/start/camera_guess.h"

namespace plenocal {

/// A bundle from which the adjustment starts.
struct BundleGuess {
  std::vector<CameraGuess> cameras;  ///< each by itself
  Bundle bundle;
  std::vector<std::string> frames;  ///< names, sorted; index as in Bundle::T_rig_target
  std::vector<LeftOut> left_out;
  std::vector<AssumedSigmas> sigmas;  ///< per camera
  /// The problem with several targets as parts of one; `cameras` belongs to its views.
  std::optional<CalibrationInput> linked = {};
  std::vector<Finding> findings = {};
};

/// Throws `Error` of kind kJob when the observations do not suffice.
BundleGuess GuessBundle(const CalibrationInput& input, int threads);

}  // namespace plenocal
