// SPDX-License-Identifier: Apache-2.0
//
// Cameras of an earlier calibration in an adjustment over scene points.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// Cameras of an earlier calibration with what it determines.
struct CalibratedRig {
  std::vector<BundleCamera> cameras;  ///< the first is the rig's master
  /// Nothing when the calibration states no standard errors: all is fixed then.
  std::optional<CalibrationPrior> prior;
};

/// The cameras of these names (empty: all), in this order; the first one's frame becomes the rig's.
/// Parameters and extrinsics with a standard error are estimated, with their joint covariance as
/// prior; those with none, and those that the calibration leaves open, are fixed. Throws `Error` of
/// kind kInput for an unknown name.
CalibratedRig MakeCalibratedRig(const CalibrationRecord& calibration,
                                std::span<const std::string> names);

}  // namespace plenocal
