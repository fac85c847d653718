// SPDX-License-Identifier: Apache-2.0
//
// Poses and residuals of frames that a calibration has not used.
#pragma once

#include <span>
#include <vector>

#include "assess/held_out/held_out_scores.h"
#include "calib/adjust/bundle.h"

namespace plenocal {

/// One observation of a camera whose model is tried.
struct TrialPoint {
  size_t camera = 0, view = 0, frame = 0;
  const Observation* seen = nullptr;
  std::span<const double> by_nuisance = {};  ///< as in `View`
};

/// Frames that were held out, every `folds`-th of them in one part.
struct HeldOutFrames {
  std::span<const TrialPoint> points;  ///< all, in the order of their frames
  size_t folds = 0;
};

/// Gives the frames of part `fold` the poses that fit best to `trained`, the cameras, markers and
/// jitter of an adjustment without them, and fills `residuals` of their points. Outliers do not
/// count for the poses, but have residuals. Of a rig that is not rigid each view gets its own pose;
/// points of a frame without a pose stay unimaged. Throws `Error` of kind kJob when the adjustment
/// fails.
void PredictHeldOut(const Bundle& trained,
                    const HeldOutFrames& frames,
                    size_t fold,
                    const std::vector<bool>& outliers,
                    std::vector<HeldOutResidual>* residuals);

}  // namespace plenocal
