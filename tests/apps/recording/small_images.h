// SPDX-License-Identifier: Apache-2.0
//
// Images of a few bytes and archives, for tests of recordings.
#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <string>

#include "engine/recording/stores/zip_archive.h"

namespace plenocal::testing {

/// A PGM whose pixels have all this value.
inline std::string FlatImage(int value, int width = 16, int height = 12) {
  return fmt::format("P5\n{} {}\n255\n", width, height) +
         std::string(static_cast<size_t>(width) * height, static_cast<char>(value));
}

/// A PGM as a colour sensor gives it: red at every second pixel of every second row, and so on.
inline std::string MosaicImage(int size = 64) {
  std::string image = fmt::format("P5\n{0} {0}\n255\n", size);
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      const int level = 80 + x / 4;  // a scene
      const double filter = (x + y) % 2 == 1 ? 1 : x % 2 == 0 ? 0.6 : 0.7;
      image += static_cast<char>(level * filter);
    }
  }
  return image;
}

/// Writes a zip archive of these files.
inline void WriteZip(const std::filesystem::path& path,
                     const std::map<std::string, std::string>& files) {
  std::ofstream(path, std::ios::binary) << ZipBytes({files.begin(), files.end()});
}

}  // namespace plenocal::testing
