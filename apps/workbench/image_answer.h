// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "apps/workbench/http/guard.h"
#include "calib/files/frame_images.h"

namespace plenocal::workbench {

/// An image as JPEG, at most `width` pixels wide (0: as it is). Throws `Error` of kind kInput for a
/// file that does not lie beneath `root`, is no image, or has more than 200 megapixels.
Answer ImageAnswer(const std::filesystem::path& root, const FrameImage& image, int width);

}  // namespace plenocal::workbench
