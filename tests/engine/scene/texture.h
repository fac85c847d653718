// SPDX-License-Identifier: Apache-2.0
//
// Random textures for tests of trackers.
#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace plenocal::testing {

/// 8-bit grey noise, smoothed to `sigma` px.
inline cv::Mat Texture(unsigned seed, int width, int height, double sigma) {
  cv::RNG random(seed);
  cv::Mat texture(height, width, CV_32F);
  random.fill(texture, cv::RNG::NORMAL, 0, 1);
  cv::GaussianBlur(texture, texture, {}, sigma);
  texture = 128 + texture * (40 * 2 * sigma);
  cv::Mat grey;
  texture.convertTo(grey, CV_8U);
  return grey;
}

}  // namespace plenocal::testing
