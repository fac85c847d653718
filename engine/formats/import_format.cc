// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/import_format.h"

#include <fmt/format.h>

#include <algorithm>

namespace plenocal {

const ImportFormat* FindImportFormat(std::string_view name) {
  const auto found = std::ranges::find(ImportFormats(), name, &ImportFormat::name);
  return found == ImportFormats().end() ? nullptr : &*found;
}

std::string ImportFormatList() {
  std::string list;
  for (const ImportFormat& format : ImportFormats()) {
    list += fmt::format("{}{}{} OUT/{}",
                        list.empty() ? "" : "; ",
                        format.name,
                        format.source.empty() ? "" : fmt::format(" ({})", format.source),
                        format.result);
  }
  return list;
}

}  // namespace plenocal
