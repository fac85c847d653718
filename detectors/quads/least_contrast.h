// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

namespace plenocal::internal {

/// Least difference between white and black, grey values, at which libapriltag
/// (`qtp.min_white_black_diff`) has to look for the outlines of quads in `gray` (8 bits): what the
/// image noise alone hardly gives, and at least the library's own 5. Outlines of noise would take
/// most of its time.
int LeastContrast(const cv::Mat& gray);

}  // namespace plenocal::internal
