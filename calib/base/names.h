// SPDX-License-Identifier: Apache-2.0
//
// Lists of names, for messages and tables.
#pragma once

#include <algorithm>
#include <array>
#include <cctype>
#include <iterator>
#include <string>
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

/// The words between the blanks of `text`, as views of it: for lists of keys.
inline std::vector<std::string_view> Words(std::string_view text) {
  std::vector<std::string_view> words;
  while (!text.empty()) {
    words.push_back(text.substr(0, text.find(' ')));
    text.remove_prefix(std::min(words.back().size() + 1, text.size()));
  }
  return words;
}

/// A name with its Latin letters in lower case.
inline std::string LowerCase(std::string name) {
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return name;
}

/// Names of the coordinates of T_camera_rig in messages and tables.
inline constexpr std::array kExtrinsicsNames{"x", "y", "z", "w_x", "w_y", "w_z"};

}  // namespace plenocal
