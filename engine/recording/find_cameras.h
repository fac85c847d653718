// SPDX-License-Identifier: Apache-2.0
//
// Finds the cameras in folders of images by the names of folders and files.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace plenocal {

/// A camera found by the names of folders and image files.
struct FoundCamera {
  std::string name;
  std::vector<std::string> images;    ///< globs, a folder or files, as in a session
  std::vector<std::string> white;     ///< likewise; empty: there are no white images
  size_t count = 0, white_count = 0;  ///< files
};

/// The cameras whose images lie in one folder: one, or those whose names share frames, such as
/// left01.jpg and right01.jpg, 001_cam0.png and 001_cam1.png. Throws `Error` without images.
std::vector<FoundCamera> CamerasInFolder(const std::filesystem::path& folder);

/// The cameras in a folder and those below it. Images in `*_white` or `white` are the white images
/// of the camera beside or above. Result folders and hidden folders below it are skipped.
std::vector<FoundCamera> FindCameras(const std::filesystem::path& folder);

}  // namespace plenocal
