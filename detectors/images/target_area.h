// SPDX-License-Identifier: Apache-2.0
//
// Blur and saturation of the part of an image that shows the target.
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "calib/camera/observation.h"

namespace plenocal::internal {

/// How an image shows the target.
struct TargetArea {
  /// Standard deviation of the blur across the edges, px: of their most blurred direction, since
  /// motion blurs one only. At least 0.5; 0 where there are no edges.
  double blur = 0;
  double saturated = 0;  ///< part of the area that is as light as 8 bits can be
};

/// Measures the area between the markers (their convex hull). `gray`: CV_8UC1.
TargetArea MeasureTargetArea(const cv::Mat& gray, const std::vector<Observation>& markers);

}  // namespace plenocal::internal
