// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <initializer_list>
#include <span>
#include <string>
#include <string_view>

#include "calib/yaml.h"
#include "targets/target.h"
#include "targets/target_layouts.h"

/// What the readers of our own target files and of Kalibr's share. `node` is the file's root.
namespace plenocal::internal {

/// Number of columns or rows, from `least` to 1000.
int ReadCount(const YamlNode& node, int least);

/// The entry of `books` that `node` names.
const CodeBook& ReadCodeBook(const YamlNode& node,
                             std::span<const CodeBook> books,
                             std::string_view what);

/// Refuses keys other than `keys`, `tolerance`, `markers` and `sigma`.
void CheckTargetKeys(const YamlNode& node, std::initializer_list<std::string_view> keys);

/// Target of a regular tag grid; `grid_node` is where a grid with too many tags is reported.
Target TagGridTarget(const TagGrid& grid,
                     const CodeBook& family,
                     int border_bits,
                     const YamlNode& grid_node);

/// Kalibr's own target file without `markers` and `tolerance`.
Target ReadKalibrTarget(const YamlNode& node);

}  // namespace plenocal::internal
