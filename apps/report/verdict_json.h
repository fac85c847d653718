// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include "calib/files/finding.h"

namespace plenocal {

/// {grade, findings: [{code, grade, cameras, value, limit, what, remedy}]}, as in calibration.yaml;
/// numbers that a finding does not have are null.
nlohmann::json VerdictJson(const Verdict& verdict);

}  // namespace plenocal
