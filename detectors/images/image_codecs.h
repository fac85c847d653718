// SPDX-License-Identifier: Apache-2.0
//
// The image file formats of OpenCV's imgcodecs. This is the only place that calls it: Debian's
// imgcodecs depends on some 120 shared libraries (GDAL and what it reads), whose loading takes ten
// times as long as the start of the rest of the program. So it is loaded with the first image, and
// commands that read none start without it.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace plenocal {

/// `cv::imdecode`: the pixels of an image file's content. `flags` are cv::ImreadModes; empty when
/// no decoder accepts the content, or it has more than `kMostPixels`. Throws `Error` of kind kJob
/// when imgcodecs cannot be loaded.
cv::Mat DecodeImage(const std::vector<std::uint8_t>& content, int flags);

/// `cv::imencode`: the content of an image file of this format, such as ".png". `parameters` are
/// cv::ImwriteFlags, each followed by its value. Throws `Error` of kind kJob when OpenCV cannot
/// write such an image or imgcodecs cannot be loaded.
std::string EncodeImage(const std::string& format,
                        const cv::Mat& image,
                        const std::vector<int>& parameters);

}  // namespace plenocal
