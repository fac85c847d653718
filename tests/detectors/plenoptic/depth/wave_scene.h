// SPDX-License-Identifier: Apache-2.0
//
// Raw images of a plane at one virtual depth, whose texture is a sum of plane waves. A blur
// multiplies each wave by a factor, so that pixels are exact values in closed form: no sampling, no
// interpolation and no first-order expansion, as matching has them.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <opencv2/core.hpp>
#include <optional>
#include <random>

#include "calib/camera/micro_lens_array.h"
#include "detectors/plenoptic/depth/lens_patches.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"

namespace plenocal::internal {

struct WaveScene {
  double v = 3.5;                ///< virtual depth
  std::array<double, 3> blur{};  ///< sigma by lens type, px of a micro image
  /// The same of micro images in the right half.
  std::optional<double> right_v = {};
  std::array<double, 3> right_blur{};
  double amplitude = 12;  ///< of each wave, grey values
  double noise = 0.5;     ///< sigma, grey values
  MicroLensArray array = PlenopticScene{}.Array();

  /// Grey value at the pixel x of the micro image of a lens.
  [[nodiscard]] double Value(const Eigen::Vector2d& x, const MicroLens& lens) const {
    constexpr int kWaves = 9;
    constexpr double kShortest = 8, kStep = 0.9;  // wavelengths, px of a micro image
    const bool right = right_v && 2 * lens.centre.x() > array.image_size[0];
    const double depth = right ? *right_v : v;
    const Eigen::Vector2d q = lens.centre + depth * (x - lens.centre);
    const double sigma = (right ? right_blur : blur)[static_cast<std::size_t>(lens.type)];
    double value = 150;
    for (int i = 0; i < kWaves; ++i) {
      const double angle = 0.2 + 2.4 * i,
                   wave_number = 2 * std::numbers::pi / (kShortest + kStep * i);
      const Eigen::Vector2d direction(std::cos(angle), std::sin(angle));
      const double kept = std::exp(-0.5 * wave_number * wave_number * sigma * sigma);
      value += amplitude * kept * std::sin(wave_number / depth * direction.dot(q) + 1.3 * i);
    }
    return value;
  }

  /// The micro images, without vignetting.
  [[nodiscard]] LensPatches Patches() const {
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    cv::Mat raw(array.image_size[1], array.image_size[0], CV_32F, cv::Scalar(0));
    cv::Mat nearest(raw.size(), CV_32F, cv::Scalar(1e9));
    for (const MicroLens& lens : array.lenses) {
      const Eigen::Vector2i c = lens.centre.cast<int>();
      const int reach = static_cast<int>(array.Pitch());
      for (int y = std::max(0, c.y() - reach); y <= std::min(raw.rows - 1, c.y() + reach); ++y) {
        for (int x = std::max(0, c.x() - reach); x <= std::min(raw.cols - 1, c.x() + reach); ++x) {
          const Eigen::Vector2d pixel(x, y);
          const auto r = static_cast<float>((pixel - lens.centre).norm());
          if (r >= nearest.at<float>(y, x)) continue;
          nearest.at<float>(y, x) = r;
          raw.at<float>(y, x) = static_cast<float>(Value(pixel, lens) + noise * normal(random));
        }
      }
    }
    const cv::Mat even(raw.size(), CV_32F, cv::Scalar(1));
    return CutPatches(raw, even, array, std::nullopt, 2);
  }
};

}  // namespace plenocal::internal
