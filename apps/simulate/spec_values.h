// SPDX-License-Identifier: Apache-2.0
//
// Values of a simulation's specification with their limits. All functions throw `Error` with file,
// line and key.
#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

#include "calib/base/error.h"
#include "calib/io/yaml.h"

namespace plenocal::simulate {

/// The path that `node` holds, relative to the folder of the specification.
std::filesystem::path PathBeside(const std::filesystem::path& spec, const YamlNode& node);

/// Sets `value` to the number of `key`, if it is there; within [low, high].
void ReadNumber(const YamlNode& node, std::string_view key, double low, double high, double* value);
void ReadInteger(const YamlNode& node, std::string_view key, int low, int high, int* value);

/// Index of the text of `node` in `choices`.
template <std::size_t N>
std::size_t ReadChoice(const YamlNode& node, const std::array<std::string_view, N>& choices) {
  const std::string text = node.AsString();
  for (std::size_t i = 0; i < N; ++i) {
    if (choices[i] == text) return i;
  }
  node.Fail(fmt::format(
      "expected {}, found '{}'{}", fmt::join(choices, " or "), text, SuggestName(text, choices)));
}

}  // namespace plenocal::simulate
