// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace plenocal::workbench {

/// The content of a regular file beneath `root`, which no link on the way leaves (openat2 with
/// RESOLVE_BENEATH). Throws `Error` of kind kInput for one that is not there, is no regular file,
/// lies elsewhere or is longer than `most` bytes.
std::vector<std::uint8_t> ReadBeneath(const std::filesystem::path& root,
                                      const std::filesystem::path& file,
                                      size_t most);

/// Whether a path lies beneath `root`, by components, links in it not followed.
bool IsBeneath(const std::filesystem::path& root, const std::filesystem::path& file);

/// The path of a file as one relative to `root`, by components, links in it not followed. Throws
/// `Error` of kind kInput when it lies elsewhere.
std::filesystem::path RelativeTo(const std::filesystem::path& root,
                                 const std::filesystem::path& file);

}  // namespace plenocal::workbench
