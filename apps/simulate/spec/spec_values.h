// SPDX-License-Identifier: Apache-2.0
//
// Values of a simulation's specification with their limits. All functions throw `Error` with file,
// line and key.
#pragma once

#include <cstddef>
#include <filesystem>
#include <initializer_list>
#include <optional>
#include <span>
#include <string_view>
#include <variant>
#include <vector>

#include "calib/io/yaml.h"

namespace plenocal::simulate {

/// The path that `node` holds, relative to the folder of the specification.
std::filesystem::path PathBeside(const std::filesystem::path& spec, const YamlNode& node);

/// The number within [low, high] that `node` holds.
double NumberWithin(const YamlNode& node, double low, double high);

/// A key that may be missing, where its value goes, and the limits of a number.
struct SpecKey {
  std::string_view name;
  std::variant<double*, int*, bool*, std::optional<double>*, std::optional<int>*> value;
  double low = 0, high = 0;
};
/// Reads these keys of a map, which may have those of `others` besides.
void ReadKeys(const YamlNode& node,
              std::initializer_list<SpecKey> keys,
              std::vector<std::string_view> others = {});

/// Index of the text of `node` in `choices`.
std::size_t ReadChoice(const YamlNode& node, std::span<const std::string_view> choices);

/// A word of a list, and the flag that it sets.
struct SpecFlag {
  std::string_view name;
  bool* value;
};
/// Sets the flags of the words that the list of `node` has, or of its only word. `usual`: what to
/// write in place of an empty list.
void ReadFlags(const YamlNode& node, std::span<const SpecFlag> flags, std::string_view usual);

}  // namespace plenocal::simulate
