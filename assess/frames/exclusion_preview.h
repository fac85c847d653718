// SPDX-License-Identifier: Apache-2.0
//
// Prediction of a calibration without some of its points.
#pragma once

#include <functional>
#include <string>

#include "assess/views/rig_estimate.h"

namespace plenocal {

/// A calibration without some of its points, predicted.
struct ExclusionPreview {
  size_t points = 0;                     ///< left out, of those that were used
  double rms_before = 0, rms_after = 0;  ///< length of the residuals of the used points, px
  /// Standard error of the projection over the images at the nearest and farthest distance of the
  /// points and, of ordinary cameras, ten times the farthest, px; infinite while something is not
  /// determined.
  double sigma_before = 0, sigma_after = 0;
  double sigmas = 0;    ///< largest change of a parameter or extrinsic, in its standard errors now
  std::string unknown;  ///< the one that changes most
};

/// By one Newton step from the adjustment, as `FrameInfluences`; outliers stay what they are.
/// `leaves_out`: whether an observation is left out. Throws `Error` of kind kJob where no camera
/// images a point at these distances.
ExclusionPreview PreviewExclusion(RigEstimate rig,
                                  const ViewTarget& shape,
                                  const std::function<bool(const BundleObservation&)>& leaves_out);

}  // namespace plenocal
