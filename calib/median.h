// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace plenocal {

/// The median; of an even number of values the upper one of the middle two. `of_none`: for no
/// values.
template <typename T>
T Median(std::vector<T> values, T of_none = T(0)) {
  if (values.empty()) return of_none;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace plenocal
