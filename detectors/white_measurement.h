// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "detectors/white_camera.h"

namespace plenocal::internal {

/// What `MeasureWhiteImages` finds, before it becomes the content of files.
struct WhiteMeasurement {
  WhiteCamera camera;   ///< without attenuation_tiff and grid_png
  cv::Mat attenuation;  ///< CV_32F, of the size of the images
  cv::Mat levelled;     ///< CV_32F, the mean white image in which the grid was found; plenoptic
};

/// Throws as `MeasureWhiteImages` does.
WhiteMeasurement MeasureWhite(const std::vector<FrameImage>& images, const WhiteOptions& options);

}  // namespace plenocal::internal
