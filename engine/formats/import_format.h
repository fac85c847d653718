// SPDX-License-Identifier: Apache-2.0
//
// Files of other tools that `plenocal import` makes files of plenocal of, cameras aside
// (camera_format.h). Each format is one file of engine/formats/imports: kalibr_target.cc defines
// `ImportFormat KalibrTargetFormat()`. CMake finds the files and generates the table
// `ImportFormats()`, so a new format is a new file and edits no other.
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// A file to read, or a folder.
struct ImportSource {
  std::filesystem::path path;
  std::optional<ImageSize> image_size;  ///< from the user, for files that do not hold it
};

struct ImportedFile {
  std::string content;
  std::string message;  ///< for the user; may be empty
  /// Names and contents of files that the content refers to; they are written beside it.
  std::vector<std::pair<std::string, std::string>> beside = {};
};

/// One tool's file format.
struct ImportFormat {
  std::string_view name;    ///< as `--format` takes it
  std::string_view source;  ///< name of the tool's files, for `--help`; empty: the format's name
  std::string_view
      result;  ///< name of the file made; "<file>" stands for the stem of the tool's file
  /// Throws `Error` of kind kInput with file and place.
  ImportedFile (*read)(const ImportSource& source);
};

/// All formats, in alphabetical order of their files.
std::span<const ImportFormat> ImportFormats();

/// The format of that name, or null.
const ImportFormat* FindImportFormat(std::string_view name);

/// The formats for `--help`: "kalibr-target OUT/target.yaml; ...".
std::string ImportFormatList();

}  // namespace plenocal
