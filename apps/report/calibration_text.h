// SPDX-License-Identifier: Apache-2.0
//
// Writes the report's text for readers without script.
#pragma once

#include <nlohmann/json.hpp>

#include "apps/report/page_text.h"

namespace plenocal {

/// Verdict, findings, parameters and residual summary, from the data of the report's page.
PageText CalibrationText(const nlohmann::json& report);

}  // namespace plenocal
