// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "calib/camera/observation.h"
#include "detectors/plenoptic/markers/marker_measurement.h"

namespace plenocal {

/// The views of a camera from the measurements of all its raw images, parallel to `frames`, with
/// the corrections of markers (vignetting and depth) by what all of them show.
std::vector<View> CorrectedViews(const std::vector<std::string>& frames,
                                 int lens_types,
                                 std::vector<internal::RawMeasurements> images);

}  // namespace plenocal
