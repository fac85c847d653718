// SPDX-License-Identifier: Apache-2.0
//
// Resampling of images by one map, with cv::remap.
#pragma once

#include <array>
#include <opencv2/core/mat.hpp>
#include <string>

#include "engine/resample/pixel_map.h"

namespace plenocal {

/// Names of the ways to interpolate.
inline constexpr std::array kInterpolations{"linear", "nearest", "cubic", "lanczos"};

/// Applies one map to images: cv::remap, black where the map has no source.
class Remap {
 public:
  /// `interpolation`: one of kInterpolations.
  Remap(const PixelMap& map, const std::string& interpolation);

  [[nodiscard]] cv::Mat operator()(const cv::Mat& image) const;
  /// CV_8U: 255 where the map has a source, else 0.
  [[nodiscard]] const cv::Mat& Mask() const { return mask_; }

 private:
  cv::Mat place_, fraction_;  // in the fixed-point form that cv::remap would make each time
  cv::Mat mask_;
  int interpolation_;
};

}  // namespace plenocal
