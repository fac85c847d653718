// SPDX-License-Identifier: Apache-2.0
//
// What the readers of target files share. `node` is the value that a message is about.
#pragma once

#include <Eigen/Core>
#include <span>
#include <string_view>
#include <vector>

#include "calib/io/yaml.h"
#include "targets/code_books.h"
#include "targets/target_type.h"

namespace plenocal::internal {

/// Number of columns or rows, from `least` to 1000.
int ReadCount(const YamlNode& node, int least);

/// The value of a length that nobody has measured: it is the unit of all lengths.
inline constexpr std::string_view kUnknown = "unknown";

/// Side or distance of a printed pattern, m; 1 of `kUnknown`. One above 2 m or below 0.1 mm is a
/// slip of the unit, unless the unit is written.
double ReadPrintedLength(const YamlNode& node);

/// Three coordinates, m.
Eigen::Vector3d ReadVector(const YamlNode& node);

/// The entry of `books` that `node` names.
const CodeBook& ReadCodeBook(const YamlNode& node,
                             std::span<const CodeBook> books,
                             std::string_view what);

/// The keys of a table that belong to the file's root, or, with `list`, to each element of that
/// list.
std::vector<std::string_view> KeyNames(std::span<const TargetKey> keys, std::string_view list = {});

}  // namespace plenocal::internal
