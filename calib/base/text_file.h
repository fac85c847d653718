// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace plenocal {

/// A file's content. Throws `Error` of kind kInput, naming the file, when there is none or it
/// cannot be read.
std::string ReadTextFile(const std::filesystem::path& path);

}  // namespace plenocal
