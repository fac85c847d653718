// SPDX-License-Identifier: Apache-2.0
//
// Path of the program, or of the library or module, that this code is part of.
#pragma once

#include <dlfcn.h>

#include <filesystem>
#include <string_view>

namespace plenocal {

inline std::filesystem::path OwnFile() {
  Dl_info info{};
  const bool is_found = dladdr(reinterpret_cast<const void*>(&OwnFile), &info) != 0;
  // The name of a program is its first argument, which may be relative.
  const bool is_library =
      is_found && std::string_view(info.dli_fname).find(".so") != std::string_view::npos;
  return is_library ? info.dli_fname : "/proc/self/exe";
}

}  // namespace plenocal
