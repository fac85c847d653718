// SPDX-License-Identifier: Apache-2.0
//
// Pictures of results: differences over the image, and charts of trajectory errors.
#pragma once

#include <string>

#include "apps/charts/bar_chart.h"
#include "apps/evaluate/evaluate_runs.h"
#include "assess/compare_calibrations.h"
#include "assess/convert.h"

namespace plenocal {

/// difference.png of `plenocal compare`: a map of each camera and distance.
std::string DifferencePicture(const CalibrationComparison& comparison);

/// The errors of a conversion of `camera` to `model`.
std::string ConversionPicture(const CalibratedCamera& camera,
                              const CameraModel& model,
                              const Conversion& conversion);

/// The errors of all runs as bars.
std::string EvaluationPicture(const Evaluation& evaluation, PictureFormat format);

}  // namespace plenocal
