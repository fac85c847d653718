// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/reduced.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace plenocal {

cv::Mat Reduced(const cv::Mat& image, double scale) {
  if (!(scale < 1)) return image;
  cv::Mat reduced;
  cv::resize(image,
             reduced,
             {},
             std::max(scale, 1.0 / image.cols),
             std::max(scale, 1.0 / image.rows),
             cv::INTER_AREA);
  return reduced;
}

}  // namespace plenocal
