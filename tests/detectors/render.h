// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <utility>

namespace plenocal::testing {

/// Gray level (0 to 255) at a point of a plane: of a pattern, or of the ideal image, where (0, 0)
/// is the centre of the top-left pixel.
using GrayFunction = std::function<double(const Eigen::Vector2d&)>;

struct RenderOptions {
  double blur = 0;        ///< standard deviation of the Gaussian blur, px
  double noise = 0;       ///< standard deviation of the noise, gray levels
  unsigned seed = 1;      ///< of the noise
  int supersampling = 8;  ///< samples a pixel along each axis
};

/// The ideal image of a plane: `H_image_plane` maps points of the plane to pixels.
inline GrayFunction View(GrayFunction plane, const Eigen::Matrix3d& H_image_plane) {
  return [plane = std::move(plane),
          inverse = Eigen::Matrix3d(H_image_plane.inverse())](const Eigen::Vector2d& pixel) {
    return plane((inverse * pixel.homogeneous()).hnormalized());
  };
}

/// CV_8UC1: the mean of `scene` over each pixel's area, blurred, with noise.
inline cv::Mat Render(const GrayFunction& scene, cv::Size size, const RenderOptions& options) {
  // Blurred before it is rounded; the margin keeps the blur free of the image's borders.
  const int margin = static_cast<int>(std::ceil(5 * options.blur));
  const int n = options.supersampling;
  cv::Mat image(size.height + 2 * margin, size.width + 2 * margin, CV_32F);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      double sum = 0;
      for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
          sum += scene({x - margin + (j + 0.5) / n - 0.5, y - margin + (i + 0.5) / n - 0.5});
        }
      }
      image.at<float>(y, x) = static_cast<float>(sum / (n * n));
    }
  }
  if (options.blur > 0) {
    const int kernel = 2 * margin + 1;
    cv::GaussianBlur(image, image, {kernel, kernel}, options.blur);
  }
  image = image(cv::Rect({margin, margin}, size)).clone();
  if (options.noise > 0) {
    std::mt19937 random(options.seed);
    std::normal_distribution<float> normal(0, static_cast<float>(options.noise));
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) image.at<float>(y, x) += normal(random);
    }
  }
  cv::Mat gray;
  image.convertTo(gray, CV_8U);
  return gray;
}

}  // namespace plenocal::testing
