// SPDX-License-Identifier: Apache-2.0
//
// Measurements of markers in micro images.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <span>
#include <vector>

#include "calib/camera/observation.h"

namespace plenocal::internal {

/// A marker measured in one micro image, with the sensitivity of its position to the two systematic
/// errors that the bundle adjustment estimates (docs/plenoptic.md, "Corrections").
struct MarkerMeasurement {
  Observation observation;   ///< x, y, lens_x, lens_y
  double inverse_depth = 0;  ///< 1 / v by which the fitted template was scaled
  /// Change of (x, y) per px^2 of k_pixel and of k (aperture_shape.h), 1 / px.
  Eigen::Matrix2d vignetting_sensitivity = Eigen::Matrix2d::Zero();
  /// Change of (x, y), px, with ln v of the template.
  Eigen::Vector2d depth_sensitivity{0, 0};
  /// Change of (x, y), px, with the gradient of ln v of the template in the virtual image, 1 / px.
  Eigen::Matrix2d gradient_sensitivity = Eigen::Matrix2d::Zero();
  int lens_type = 0;
  /// Blur of this marker alone and its standard error, px; 0: not measured.
  double blur = 0, blur_sigma = 0;

  [[nodiscard]] Eigen::Vector2d Position() const {
    return {observation.values[0], observation.values[1]};
  }
  /// The micro-image centre.
  [[nodiscard]] Eigen::Vector2d Centre() const {
    return {observation.values[2], observation.values[3]};
  }
  void Move(const Eigen::Vector2d& by) {
    observation.values[0] += by.x();
    observation.values[1] += by.y();
  }
};

/// All measurements in one raw image by ascending marker number.
using RawMeasurements = std::vector<MarkerMeasurement>;

/// The range of depths and places in which markers were measured.
class MeasuredRange {
 public:
  explicit MeasuredRange(std::span<const RawMeasurements> images);
  /// Of a linear interpolation in inverse virtual depth: weights of the values at the nearest and
  /// at the farthest marker.
  [[nodiscard]] Eigen::Vector2d DepthWeights(double inverse_depth) const;
  /// A micro-image centre between the outermost ones, -1 to 1.
  [[nodiscard]] Eigen::Vector2d Place(const Eigen::Vector2d& centre) const;

 private:
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();
  double low_ = kInfinity, high_ = -kInfinity;  ///< inverse depths
  Eigen::Vector2d least_{kInfinity, kInfinity}, most_{-kInfinity, -kInfinity};
};

}  // namespace plenocal::internal
