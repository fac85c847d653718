// SPDX-License-Identifier: Apache-2.0
//
// Residuals of a calibration, camera by camera.
#pragma once

#include "calib/adjust/bundle.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// Standard deviations of one camera's observations before the residuals are known, px.
struct AssumedSigmas {
  double typical = 1;   ///< median of `BundleObservation::assumed_sigma`
  bool stated = false;  ///< by the detector
};

/// Reprojection error of camera `camera` of a bundle at its optimum.
CameraFit MeasureFit(const Bundle& bundle, size_t camera, const AssumedSigmas& assumed);

}  // namespace plenocal
