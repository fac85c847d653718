// SPDX-License-Identifier: Apache-2.0
//
// Smaller pictures of images.
#pragma once

#include <opencv2/core/mat.hpp>

namespace plenocal {

/// The image reduced by `scale`, each pixel a mean; one of one row keeps it. The image itself where
/// `scale` is not below 1.
cv::Mat Reduced(const cv::Mat& image, double scale);

}  // namespace plenocal
