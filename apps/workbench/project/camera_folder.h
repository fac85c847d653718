// SPDX-License-Identifier: Apache-2.0
//
// Finds the folder in which a session looks for a camera's images.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "calib/files/session.h"

namespace plenocal::workbench {

/// A folder beneath the workbench's root whose images belong to a camera.
struct CameraFolder {
  std::filesystem::path folder;  ///< relative to the root; empty: the root itself
  std::string names;             ///< glob of the images' names: "*.png", or "*" for all images

  [[nodiscard]] bool Has(const std::string& name) const;
};

/// Of the first of the camera's patterns that stands for such a folder; nothing: the images are
/// listed one by one, lie elsewhere, or in recordings.
std::optional<CameraFolder> FolderOf(const std::filesystem::path& root,
                                     const SessionCamera& camera);

}  // namespace plenocal::workbench
