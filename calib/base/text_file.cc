// SPDX-License-Identifier: Apache-2.0
#include "calib/base/text_file.h"

#include <fmt/format.h>

#include <fstream>

#include "calib/base/error.h"

namespace plenocal {

std::string ReadTextFile(const std::filesystem::path& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) {
    throw Error(ErrorKind::kInput, fmt::format("{}: no such file", path.string()));
  }
  std::ifstream file(path, std::ios::binary);
  if (std::filesystem::is_directory(path, error) || !file) {
    throw Error(ErrorKind::kInput, fmt::format("{}: cannot be read", path.string()));
  }
  std::string text;
  // In large pieces: long trajectories are read within a second.
  std::string piece(1 << 20, '\0');
  while (file.read(piece.data(), static_cast<std::streamsize>(piece.size())) || file.gcount() > 0) {
    text.append(piece, 0, static_cast<size_t>(file.gcount()));
  }
  if (file.bad()) throw Error(ErrorKind::kInput, fmt::format("{}: cannot be read", path.string()));
  return text;
}

}  // namespace plenocal
