// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include "assess/residual_field.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// `FieldRms` of web/src/report/types.ts.
nlohmann::json FieldJson(const ResidualField& field);

/// Plots of one camera's residuals: sample of points, field, histogram, per frame,
/// per marker, per lens type, coverage of image and depth. `most_points`: points of the sample,
/// which is every k-th one. `lens_types`: per row of `residuals`, -1 unknown; may be empty.
nlohmann::json ResidualSections(const CalibrationRecord& calibration,
                                size_t camera,
                                size_t most_points,
                                const std::vector<int>& lens_types);

/// `value` with `digits` significant digits: short in the page. Null when not finite.
nlohmann::json Short(double value, int digits = 4);

}  // namespace plenocal
