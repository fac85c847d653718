// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include "assess/check.h"

namespace plenocal {

/// {grade, findings: [{code, grade, cameras, value, limit, what, remedy}]}, as in calibration.yaml;
/// numbers that a finding does not have are null.
nlohmann::json VerdictJson(const Verdict& verdict);

/// Content of check.json: {valid, frames, verdict, cameras}.
nlohmann::json CheckJson(const CalibrationCheck& check);

/// {verdict, cameras: {name: {model, parameters, ...}}, frames} of a calibration with a verdict.
nlohmann::json CalibrationJson(const CalibrationRecord& record);

}  // namespace plenocal
