// SPDX-License-Identifier: Apache-2.0
//
// Another tool's files as one of plenocal.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/camera/camera_model.h"

namespace plenocal {

struct ImportRequest {
  std::vector<std::filesystem::path> files;
  std::string format;             ///< name of a `CameraFormat` or an `ImportFormat`
  std::optional<ImageSize> size;  ///< px, for files that hold none
  bool fisheye = false;           ///< for files of OpenCV that do not mark fisheye coefficients
  std::filesystem::path out;      ///< folder, or the file to write
};

/// Returns the file written. Throws `Error`.
std::filesystem::path ImportFiles(const ImportRequest& request, const Run& run);

}  // namespace plenocal
