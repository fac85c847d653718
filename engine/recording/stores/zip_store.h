// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/files/frame_images.h"

namespace plenocal {

/// The images in a zip archive by name, or in one folder of it; the frame of each is its file's
/// stem. Throws `Error` of kind kInput, which begins with `what`, when there is none.
std::vector<FrameImage> ZipImages(const std::filesystem::path& archive,
                                  const std::string& folder,
                                  const std::string& what);

}  // namespace plenocal
