// SPDX-License-Identifier: Apache-2.0
#include "apps/formats/camera_format.h"

#include <fmt/format.h>

namespace plenocal {

const CameraFormat* FindCameraFormat(std::string_view name, const std::filesystem::path& file) {
  const CameraFormat* found = nullptr;
  for (const CameraFormat& format : CameraFormats()) {
    if (format.variant_of == name && format.extension == file.extension().string()) return &format;
    if (format.name == name) found = &format;
  }
  return found;
}

std::string CameraFormatList() {
  std::string list;
  for (const CameraFormat& format : CameraFormats()) {
    if (!format.variant_of.empty()) continue;
    list += fmt::format("{}{}", list.empty() ? "" : ", ", format.name);
    for (const CameraFormat& other : CameraFormats()) {
      if (other.variant_of == format.name)
        list += fmt::format(" (FILE or FILE{})", other.extension);
    }
  }
  return list;
}

}  // namespace plenocal
