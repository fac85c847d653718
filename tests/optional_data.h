// SPDX-License-Identifier: Apache-2.0
//
// Image sets: a few are part of the repository (tests/data), the others optional (docs/data.md).
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace plenocal {

/// A set's folder, or a file in it: in the repository where it is part of it, else below the folder
/// that the environment variable PLENOCAL_DATA names. Without the variable a path that does not
/// exist and shows its name.
inline std::filesystem::path OptionalData(const std::string& set) {
  auto own = std::filesystem::path(PLENOCAL_TEST_DATA) / set;
  if (std::filesystem::exists(own)) return own;
  const char* folder = std::getenv("PLENOCAL_DATA");
  if (folder == nullptr || *folder == '\0') return std::filesystem::path("$PLENOCAL_DATA") / set;
  return std::filesystem::absolute(folder) / set;
}

/// Why a test that needs it is skipped.
inline std::string Absent(const std::filesystem::path& path) {
  return path.string() + " is absent: the environment variable PLENOCAL_DATA names the folder of " +
         "the optional data sets (docs/data.md)";
}

}  // namespace plenocal
