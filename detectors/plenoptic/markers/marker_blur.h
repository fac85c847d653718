// SPDX-License-Identifier: Apache-2.0
//
// Blur of markers in micro images by depth and lens type.
#pragma once

#include <span>
#include <vector>

#include "calib/camera/lens_type_optics.h"
#include "detectors/plenoptic/markers/marker_measurement.h"

namespace plenocal::internal {

/// Medians of the blur over markers of like depth and place, by raw image and lens type.
std::vector<BlurMeasurement> MeasureBlur(std::span<const RawMeasurements> images);

}  // namespace plenocal::internal
