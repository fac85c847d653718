// SPDX-License-Identifier: Apache-2.0
//
// Makes data of the pages from a camera's residuals: plots, and sums over frames and markers.
#pragma once

#include <functional>
#include <nlohmann/json.hpp>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// Number of the group of a row of `residuals`; negative: none.
using GroupOf = std::function<int(size_t row)>;

/// `Sums` of the schema, columns with a row for each group: its number as `key`, used and rejected
/// points, RMS (null: no used point).
nlohmann::json SumsJson(const CalibratedCamera& camera, const char* key, const GroupOf& group_of);

/// `Plots` of the schema. `most_points`: points of the sample, which is every k-th one.
/// `lens_types`: per row of `residuals`, -1 unknown; may be empty.
nlohmann::json ResidualSections(const CalibrationRecord& calibration,
                                size_t camera,
                                size_t most_points,
                                const std::vector<int>& lens_types);

}  // namespace plenocal
