// SPDX-License-Identifier: Apache-2.0
//
// The page of `plenocal accuracy`.
#pragma once

#include <string>
#include <vector>

#include "assess/space/accuracy.h"

namespace plenocal {

/// accuracy.html: sigma over distance and image, findings.
std::string AccuracyPage(const std::vector<RigAccuracy>& accuracies);

}  // namespace plenocal
