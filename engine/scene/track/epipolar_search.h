// SPDX-License-Identifier: Apache-2.0
//
// Search for a point along its epipolar curve in another image.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "calib/adjust/bundle.h"

namespace plenocal {

/// A camera and its 8-bit grey image.
struct CameraImage {
  const BundleCamera* camera = nullptr;
  const cv::Mat* image = nullptr;
};

/// Position in `second` of the point that `first` shows at `point`, to about a pixel: the one along
/// the epipolar curve whose patch correlates best. Nothing when no place is clearly the best.
/// Points nearer than `nearest` baselines look too different in the two images.
std::optional<cv::Point2f> SearchEpipolarCurve(const CameraImage& first,
                                               const cv::Point2f& point,
                                               const CameraImage& second,
                                               double nearest = 4);

}  // namespace plenocal
