// SPDX-License-Identifier: Apache-2.0
//
// Differences over the image as PNG pictures.
#pragma once

#include <string>

#include "assess/compare_calibrations.h"
#include "assess/convert.h"

namespace plenocal {

/// difference.png of `plenocal compare`: a map of each camera and distance.
std::string DifferencePicture(const CalibrationComparison& comparison);

/// The errors of a conversion of `camera` to `model`.
std::string ConversionPicture(const CalibratedCamera& camera,
                              const CameraModel& model,
                              const Conversion& conversion);

}  // namespace plenocal
