// SPDX-License-Identifier: Apache-2.0
//
// Pixels in the encodings of ROS's image messages as images.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>

#include "calib/files/image_store.h"

namespace plenocal::internal {

/// Pixels as `ReadImage` gives them: 8 or 16 bits, one channel or three (BGR), of mosaics the
/// mosaic. Throws `Error` of kind kInput, which begins with `place`, for an encoding that is not
/// known or fewer bytes than pixels.
cv::Mat ImageOfPixels(const StoredImage& stored, const std::filesystem::path& place);

/// The same in grey, in the image's own depth. Colours become grey as libpng makes it, so that
/// pixels and a PNG file of them are one image.
cv::Mat GrayOfPixels(const StoredImage& stored, const std::filesystem::path& place);

}  // namespace plenocal::internal
