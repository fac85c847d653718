// SPDX-License-Identifier: Apache-2.0
#include "calib/files/finding.h"

#include <algorithm>

namespace plenocal {

std::optional<Grade> ParseGrade(std::string_view name) {
  const auto found = std::ranges::find(kGradeNames, name);
  if (found == kGradeNames.end()) return std::nullopt;
  return static_cast<Grade>(found - kGradeNames.begin());
}

}  // namespace plenocal
