// SPDX-License-Identifier: Apache-2.0
//
// The contrast below which outlines are noise, for libapriltag.
#pragma once

#include <opencv2/core.hpp>

namespace plenocal::internal {

/// Least difference between white and black, grey values, at which libapriltag
/// (`qtp.min_white_black_diff`) looks for the outlines of quads in `gray` (8 bits): six sigma of
/// the image noise, or the library's own 5 where that is more. Below, outlines of noise take most
/// of the library's time.
int LeastContrast(const cv::Mat& gray);

}  // namespace plenocal::internal
