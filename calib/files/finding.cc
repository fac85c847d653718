// SPDX-License-Identifier: Apache-2.0
#include "calib/files/finding.h"

#include <algorithm>
#include <iterator>

namespace plenocal {

std::optional<Grade> ParseGrade(std::string_view name) {
  const auto found = std::ranges::find(kGradeNames, name);
  if (found == kGradeNames.end()) return std::nullopt;
  return static_cast<Grade>(found - kGradeNames.begin());
}

void Append(std::vector<Finding> more, std::vector<Finding>* findings) {
  findings->insert(
      findings->end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
}

}  // namespace plenocal
