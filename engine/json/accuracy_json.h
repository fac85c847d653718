// SPDX-License-Identifier: Apache-2.0
//
// Writes the JSON of a predicted accuracy, for files, pages, `--json` and the workbench.
#pragma once

#include <nlohmann/json.hpp>
#include <span>
#include <string>

#include "assess/space/accuracy.h"

namespace plenocal {

/// `Accuracy`s of the schema: sigmas by cameras and distance, m. `with_maps`: sigma of each cell,
/// too.
nlohmann::json AccuracyJson(std::span<const RigAccuracy> accuracies, bool with_maps = false);

/// "left + right at 5 m: z 9.4 mm (noise 5.9, calibration 7.3); a length of 100 mm across 0.2 mm".
std::string AccuracyLine(const RigAccuracy& accuracy, const AccuracyAtDistance& at);

}  // namespace plenocal
