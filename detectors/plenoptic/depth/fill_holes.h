// SPDX-License-Identifier: Apache-2.0
//
// Interpolation of the unknown pixels of an image.
#pragma once

#include <opencv2/core/mat.hpp>

namespace plenocal::internal {

/// An image without holes.
struct Filled {
  cv::Mat value;     ///< CV_32F; NaN only when nothing was known
  cv::Mat variance;  ///< CV_32F
  /// CV_32F: side of the square that the value comes from, px; 0 where it was known.
  cv::Mat reach;
};

/// Fills the NaNs of `value` (CV_32F) from means over ever larger squares, each hole from the
/// smallest ones around it with a known value. The variance of a filled value is that of the known
/// values in those squares about their mean, plus their own.
Filled FillHoles(const cv::Mat& value, const cv::Mat& variance);

}  // namespace plenocal::internal
