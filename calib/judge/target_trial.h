// SPDX-License-Identifier: Apache-2.0
//
// Whether a target's points are to be refined, by cross-validation.
#pragma once

#include <vector>

#include "calib/calibrate.h"
#include "calib/judge/model_trial.h"

namespace plenocal {

/// Held-out frames as a rigid target and as a refined one predict them.
struct TargetTrial {
  double rms_rigid = 0, rms_refined = 0;  ///< of points that both image, px
  double probability = 1;                 ///< of so large a gain if refinement predicted no better
  bool refine = false;                    ///< it predicts significantly better
};

/// Judges `input` twice by `TryModels`, with its `marker_sigma` of 0 and of `marker_sigma`, both
/// with `model` for the `varied` cameras. The test is a one-sided t-test, at the level of 5 %, of
/// the logarithms of the ratios of the frames' mean squares, with the variance that `TryModels`
/// uses. A target that cannot be refined is rigid. Throws as `TryModels` when it is rigid.
TargetTrial TryTarget(const CalibrationInput& input,
                      double marker_sigma,
                      const std::vector<size_t>& varied,
                      const CameraModel& model,
                      const TrialOptions& options);

}  // namespace plenocal
