// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <iterator>
#include <string_view>
#include <vector>

namespace plenocal {

/// The `name` of each element, views of what the elements hold; `SuggestName` takes them.
template <typename Range>
std::vector<std::string_view> NamesOf(const Range& range) {
  std::vector<std::string_view> names(std::size(range));
  std::ranges::transform(
      range, names.begin(), [](const auto& element) -> std::string_view { return element.name; });
  return names;
}

/// Names of the coordinates of T_camera_rig in messages and tables.
inline constexpr std::array kExtrinsicsNames{"x", "y", "z", "w_x", "w_y", "w_z"};

}  // namespace plenocal
