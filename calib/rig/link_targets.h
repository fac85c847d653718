// SPDX-License-Identifier: Apache-2.0
//
// Several targets, and cameras that share no view of one, made a problem with one target: the
// targets that stay where they are with respect to each other are its parts.
#pragma once

#include <span>
#include <vector>

#include "calib/files/finding.h"
#include "calib/noise/uncertainty.h"
#include "calib/start/camera_guess.h"
#include "calib/start/input.h"

namespace plenocal {

/// Views of one target each; frames in which a camera sees several have several views of one name.
/// The markers keep their targets' own frames.
std::vector<CameraInput> SplitViews(const CalibrationInput& input);

struct LinkedInput {
  /// Markers in the frames of the first target of their body. Frames of the second body and of more
  /// are called "frame@target".
  CalibrationInput input;
  std::vector<CameraGuess> guesses;  ///< parallel to `input.cameras` and their views
  std::vector<RigidTransform> T_camera_rig;
  std::vector<BundleTarget> targets;
  std::vector<Finding> findings;  ///< how cameras were placed that share no view
};

/// `split` and `guesses`: the views of `SplitViews` with the initial guess of each camera. Throws
/// `Error` of kind kJob for cameras that nothing connects, with what to record.
LinkedInput LinkTargets(const CalibrationInput& input,
                        std::span<const CameraInput> split,
                        std::span<const CameraGuess> guesses);

/// The findings of `LinkedInput` at the optimum: extrinsics by motion whose translation is open in
/// a direction, as where the rig turned about one axis only, are named with it.
std::vector<Finding> JudgeLinks(const std::vector<Finding>& links,
                                const Bundle& bundle,
                                const Uncertainty& uncertainty);

}  // namespace plenocal
