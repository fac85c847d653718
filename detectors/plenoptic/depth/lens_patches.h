// SPDX-License-Identifier: Apache-2.0
//
// A raw plenoptic image cut into its micro images: one small square of floats per micro lens,
// divided by the attenuation. Code that compares micro images then runs over short contiguous rows
// and never mixes two of them.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdlib>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "calib/camera/micro_lens_array.h"

namespace plenocal::internal {

/// Noise of the sensor: var(raw) = read + shot * raw, grey values squared.
struct SensorNoise {
  float read = 0, shot = 0;
};

/// A rectangle of a patch: columns [left, right) and rows [top, bottom).
struct PatchBox {
  int left, right, top, bottom;
};

struct LensPatches {
  /// NaN columns and rows on each side of the largest micro image, px: a row can be processed in
  /// blocks of eight that begin inside the micro image.
  static constexpr int kMargin = 4;

  int size = 0;           ///< side of a patch, px
  float radius_px = 0;    ///< largest distance of a used pixel from its micro-image centre
  int filter_radius = 0;  ///< px: 1 where values are means of 3 x 3 mosaic pixels, else 0
  /// lenses x size x size: raw value / attenuation, NaN for pixels outside of this micro image.
  std::vector<float> value;
  cv::Mat attenuation;  ///< CV_32F, of the raw image
  /// Raw pixel of each patch's top left value; may lie outside the image.
  std::vector<Eigen::Vector2i> origin;
  std::vector<Eigen::Vector2f> centre;  ///< micro-image centre in the patch, px

  [[nodiscard]] size_t Area() const { return static_cast<size_t>(size) * size; }
  [[nodiscard]] const float* Value(size_t lens) const { return value.data() + lens * Area(); }
  /// Where values may be known: the patch less its margins and what is nearer than `border` px to
  /// the outside of the image.
  [[nodiscard]] PatchBox Inside(size_t lens, int border) const;
  /// Attenuation at column x, row y of a patch. REQUIRES: the value there is known.
  [[nodiscard]] float Attenuation(size_t lens, int x, int y) const {
    return attenuation.ptr<float>(origin[lens].y() + y)[origin[lens].x() + x];
  }
  /// Weight in a value of the pixel that lies (x, y) px from the value's own; the weights sum to 1.
  [[nodiscard]] double FilterWeight(int x, int y) const {
    return (1 + filter_radius - std::abs(x)) * (1 + filter_radius - std::abs(y)) /
           std::pow(1 + filter_radius, 4);
  }
  /// The highest attenuation among a micro image's pixels; 0 for an empty patch.
  [[nodiscard]] float HighestAttenuation(size_t lens) const;
  /// Gradient of ln V at column x, row y of a patch, V the attenuation, 1 / px; zero on the edge of
  /// the image.
  [[nodiscard]] Eigen::Vector2f LogAttenuationGradient(size_t lens, int x, int y) const;
};

/// Weight of each pixel of the 2 x 2 raster of a raw mosaic, row by row from the image's top left;
/// the weights sum to 1.
using MosaicWeights = std::array<float, 4>;

/// Cuts `raw` (CV_32F, one channel) by the grid. A pixel belongs to a micro image where its
/// attenuation is at least half of the micro image's highest (the edge of a blurred disc) and it is
/// nearer to the centre than half a pitch less half a pixel. Patches of unusable micro lenses are
/// empty.
///
/// With `mosaic` each value is the mean of the 3 x 3 pixels around, all of this micro image, by
/// binomial weights times those of the raster. Of the binomial weights each of the raster's four
/// pixels has a quarter at every position, so no position prefers a colour; with one colour alone
/// the mean is linear interpolation.
LensPatches CutPatches(const cv::Mat& raw,
                       const cv::Mat& attenuation,
                       const MicroLensArray& array,
                       const std::optional<MosaicWeights>& mosaic,
                       int threads);

/// Noise from the second differences (both directions) in the smoothest micro images of each
/// brightness. At least that of rounding to whole grey values.
SensorNoise EstimateNoise(const LensPatches& patches);

}  // namespace plenocal::internal
