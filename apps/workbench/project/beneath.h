// SPDX-License-Identifier: Apache-2.0
//
// Reads and writes files beneath the workbench's folder, which no link leaves.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace plenocal::workbench {

/// The content of a regular file beneath `root`, which no link on the way leaves (openat2 with
/// RESOLVE_BENEATH). Throws `Error` of kind kInput for one that is not there, is no regular file,
/// lies elsewhere or is longer than `most` bytes.
std::vector<std::uint8_t> ReadBeneath(const std::filesystem::path& root,
                                      const std::filesystem::path& file,
                                      size_t most);
/// The same as text.
std::string TextBeneath(const std::filesystem::path& root,
                        const std::filesystem::path& file,
                        size_t most);

/// Writes a new file `name` into a folder beneath `root`, which is made where it is missing and to
/// which no link leads: all of the file or nothing. Throws `Error` of kind kInput when there is a
/// file of this name, and of kind kJob when it cannot be written.
void AddBeneath(const std::filesystem::path& root,
                const std::string& folder,
                const std::string& name,
                std::string_view content);

/// Whether a path lies beneath `root`, by components, links in it not followed.
bool IsBeneath(const std::filesystem::path& root, const std::filesystem::path& file);

/// The path of a file as one relative to `root`, by components, links in it not followed. Throws
/// `Error` of kind kInput when it lies elsewhere.
std::filesystem::path RelativeTo(const std::filesystem::path& root,
                                 const std::filesystem::path& file);

}  // namespace plenocal::workbench
