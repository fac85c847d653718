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

/// What messages and tables call the coordinates of a camera's place on the rig.
inline constexpr std::array kMountNames{"x", "y", "z", "w_x", "w_y", "w_z"};

}  // namespace plenocal
