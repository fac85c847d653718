// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "calib/camera/observation.h"

namespace plenocal {

/// A line for each reason, with the number of images or points and the first of them. Reasons that
/// differ in numbers alone count as one.
std::vector<std::string> GroupedByReason(const std::vector<LeftOut>& items);

/// The content of left_out.csv: one row an item.
std::string LeftOutCsv(const std::vector<LeftOut>& items);

}  // namespace plenocal
