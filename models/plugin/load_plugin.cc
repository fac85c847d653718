// SPDX-License-Identifier: Apache-2.0
#include "models/plugin/load_plugin.h"

#include <dlfcn.h>
#include <elf.h>
#include <fmt/format.h>

#include <cstring>
#include <fstream>
#include <string>
#include <string_view>

#include "calib/base/format_error.h"
#include "models/plugin/plugin.h"

namespace plenocal {
namespace {

[[noreturn]] void Refuse(const std::filesystem::path& path, const std::string& reason) {
  throw InputError("{}: {}", path.string(), reason);
}

}  // namespace

std::string internal::WhyNotLoadable(const std::filesystem::path& path) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) return "no such file";
  if (!std::filesystem::is_regular_file(status)) return "is no file; a plug-in is a shared library";
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  std::ifstream file(path, std::ios::binary);
  if (error || !file) return "cannot be read";
  Elf64_Ehdr header;
  if (!file.read(reinterpret_cast<char*>(&header), sizeof header) ||
      std::memcmp(header.e_ident, ELFMAG, SELFMAG) != 0 || header.e_type != ET_DYN) {
    return "is no shared library; docs/new_model.md says how a plug-in is built";
  }
  // The section table is what a linker writes last.
  const std::uintmax_t table = std::uintmax_t{header.e_shnum} * header.e_shentsize;
  if (header.e_shoff > size || table > size - header.e_shoff) {
    return "is cut off; build the plug-in again";
  }
  return {};
}

std::span<const CameraModel> LoadPlugin(const std::filesystem::path& path) {
  if (const std::string reason = internal::WhyNotLoadable(path); !reason.empty())
    Refuse(path, reason);
  // A name without a slash would be sought in the system's folders.
  void* const plugin = dlopen(std::filesystem::absolute(path).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (plugin == nullptr) Refuse(path, fmt::format("cannot be loaded: {}", dlerror()));
  const auto* const abi = static_cast<const char*>(dlsym(plugin, "plenocal_plugin_abi"));
  const void* const models = dlsym(plugin, "plenocal_plugin_models");
  if (abi == nullptr || models == nullptr) {
    Refuse(path,
           "is no plug-in: it exports no camera models (PLENOCAL_CAMERA_MODEL_PLUGIN in "
           "models/plugin/plugin.h, docs/new_model.md)");
  }
  if (std::string_view(abi) != PLENOCAL_PLUGIN_ABI) {
    Refuse(path,
           fmt::format("was built against another version ({}; this is {}); build the plug-in "
                       "again with this version's headers and without options like -march=native",
                       abi,
                       PLENOCAL_PLUGIN_ABI));
  }
  return *static_cast<const std::span<const CameraModel>*>(models);
}

}  // namespace plenocal
