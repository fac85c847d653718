// SPDX-License-Identifier: Apache-2.0
//
// The mean of a camera's white images.
#pragma once

#include <map>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "calib/camera/observation.h"
#include "calib/files/frame_images.h"

namespace plenocal {

/// The mean of a camera's white images, with figures of their quality.
struct WhiteImages {
  cv::Mat mean;                 ///< CV_32F, one channel, grey values as in the files
  std::vector<size_t> members;  ///< indices of the images in the mean
  double level = 0;             ///< mean grey value
  double full_scale = 0;        ///< grey value of a saturated pixel
  double saturated = 0;         ///< share of pixels at full scale, mean over the images
  double black = 0;             ///< share of pixels at 0
  /// Brightness difference between opposite sides of the field, relative to the middle: lens
  /// fall-off is the same on both, so this is the illumination (or a lens out of its place).
  double unevenness = 0;
  std::vector<LeftOut> left_out;  ///< images, with reasons
  /// Some images, by index, as gray: decoding them again takes longer than all sums over them.
  std::map<size_t, cv::Mat> decoded;

  /// One of the images that this is the mean of, as gray. Throws `Error` where it is not among the
  /// decoded ones and cannot be read any more.
  [[nodiscard]] cv::Mat Gray(const std::vector<FrameImage>& images, size_t i) const;
};

/// Averages white images of any kind that ReadImage reads; colour becomes gray. Left out are
/// unreadable, saturated and black images and those whose brightness or shading differs from the
/// rest. Throws `Error`: of kind kInput for images of different sizes; of kind kJob when none
/// remains or they show a scene that differs between them.
WhiteImages AverageWhiteImages(const std::vector<FrameImage>& images, int threads);

}  // namespace plenocal
