// SPDX-License-Identifier: Apache-2.0
//
// A raw plenoptic image cut into its micro images: one small square of floats a micro lens, without
// attenuation, so that what compares micro images runs over short contiguous rows and never mixes
// two.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdlib>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "calib/micro_lens_array.h"

namespace plenocal::internal {

/// Noise of the sensor: var(raw) = read + shot * raw, grey values squared.
struct SensorNoise {
  float read = 0, shot = 0;
};

struct LensPatches {
  /// NaN columns and rows on each side of the largest micro image. With seven or more a row can be
  /// read in blocks of eight that begin inside the micro image.
  static constexpr int kMargin = 4;

  int size = 0;         ///< side of a patch, px
  float radius_px = 0;  ///< farthest that a used pixel lies from its micro-image centre
  int reach = 0;        ///< px that a value's pixels lie from its own: 1 of a mosaic, else 0
  /// lenses x size x size, raw value / attenuation, NaN where the pixel is not of this micro image.
  std::vector<float> value;
  cv::Mat attenuation;  ///< CV_32F, of the raw image
  /// Raw pixel of each patch's top left value; may lie outside the image.
  std::vector<Eigen::Vector2i> origin;
  std::vector<Eigen::Vector2f> centre;  ///< micro-image centre in the patch, px

  [[nodiscard]] size_t Area() const { return static_cast<size_t>(size) * size; }
  [[nodiscard]] const float* Value(size_t lens) const { return value.data() + lens * Area(); }
  /// Attenuation at column x, row y of a patch, where its value is known.
  [[nodiscard]] float Light(size_t lens, int x, int y) const {
    return attenuation.ptr<float>(origin[lens].y() + y)[origin[lens].x() + x];
  }
  /// How much the pixel (x, y) px from a value's own counts in it; sums to 1 over `reach`.
  [[nodiscard]] double Share(int x, int y) const {
    return (1 + reach - std::abs(x)) * (1 + reach - std::abs(y)) / std::pow(1 + reach, 4);
  }
  /// The largest attenuation of a micro image's pixels; 0 without any.
  [[nodiscard]] float BrightestLight(size_t lens) const;
  /// Gradient of ln V there, V the attenuation, 1 / px; zero on the edge of the image.
  [[nodiscard]] Eigen::Vector2f LightSlope(size_t lens, int x, int y) const;
};

/// How much each pixel of the 2 x 2 raster of a raw mosaic counts, row by row from the image's top
/// left; together 1.
using MosaicWeights = std::array<float, 4>;

/// Cuts `raw` (CV_32F, one channel) by the grid. A pixel belongs to a micro image where the
/// attenuation is at least half of that micro image's highest, the edge of a blurred disc, and
/// nearer to its centre than half a pitch less half a pixel. Micro lenses that are not usable get
/// empty patches. With `mosaic` each value is the mean of the 3 x 3 pixels around, all of this
/// micro image, by these weights times the binomial ones. Of the latter each of the four pixels of
/// the raster has a quarter everywhere, so no place prefers a colour; with one colour alone this is
/// linear interpolation.
LensPatches CutPatches(const cv::Mat& raw,
                       const cv::Mat& attenuation,
                       const MicroLensArray& array,
                       const std::optional<MosaicWeights>& mosaic,
                       int threads);

/// Noise level from the smoothest micro images of each brightness: what the second differences in
/// both directions leave there. Never below that of rounding to whole grey values.
SensorNoise EstimateNoise(const LensPatches& patches);

}  // namespace plenocal::internal
