// SPDX-License-Identifier: Apache-2.0
//
// Images and points that were left out, with reasons, as messages and as a table.
#pragma once

#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/camera/observation.h"

namespace plenocal {

/// A line for each reason, with the number of images or points and the first of them. Reasons that
/// differ in numbers alone count as one.
std::vector<std::string> GroupedByReason(const std::vector<LeftOut>& items);

/// A message for each item.
void ReportLeftOut(const std::vector<LeftOut>& items, const Run& run);

/// The content of left_out.csv: one row an item.
std::string LeftOutCsv(const std::vector<LeftOut>& items);

}  // namespace plenocal
