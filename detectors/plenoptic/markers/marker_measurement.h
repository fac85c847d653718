// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <limits>
#include <span>
#include <vector>

#include "calib/camera/observation.h"

namespace plenocal::internal {

/// A marker measured in one micro image, with the sensitivity of its position to the two systematic
/// errors that are corrected later (docs/plenoptic.md, "Corrections").
struct MarkerMeasurement {
  Observation observation;   ///< x, y, lens_x, lens_y
  double inverse_depth = 0;  ///< 1 / v by which the fitted template was scaled
  /// Change of (x, y) per px^2 of k_pixel and of k (vignetting_correction.h), 1 / px.
  Eigen::Matrix2d vignetting_sensitivity = Eigen::Matrix2d::Zero();
  /// Change of (x, y), px, with ln v of the template.
  Eigen::Vector2d depth_sensitivity{0, 0};
  int lens_type = 0;

  [[nodiscard]] Eigen::Vector2d Position() const {
    return {observation.values[0], observation.values[1]};
  }
  /// The micro-image centre.
  [[nodiscard]] Eigen::Vector2d Centre() const {
    return {observation.values[2], observation.values[3]};
  }
  /// u_0 of x = u_0 + s c for s = 1 - 1 / v (docs/plenoptic.md, "One point in all its micro
  /// images"): equal in all micro images of the marker if v is right.
  [[nodiscard]] Eigen::Vector2d U0() const { return Position() - Centre() * (1 - inverse_depth); }
  /// Change of `U0` with the true 1 / v, but for a part that all micro images of the marker share;
  /// x is measured by a template for another v.
  [[nodiscard]] Eigen::Vector2d U0ByInverseDepth() const {
    return depth_sensitivity / inverse_depth - Centre();
  }
  void Move(const Eigen::Vector2d& by) {
    observation.values[0] += by.x();
    observation.values[1] += by.y();
  }
};

/// All measurements in one raw image by ascending marker number.
using RawMeasurements = std::vector<MarkerMeasurement>;

/// The measurements of each marker in each raw image where they are more than two. A marker has
/// three unknowns of its own, position and depth; two micro images have four coordinates, so only
/// from three on there is more than one redundant coordinate.
std::vector<std::span<const MarkerMeasurement>> GroupByMarker(
    std::span<const RawMeasurements> images);

/// Linear interpolation in inverse virtual depth between the nearest and the farthest marker.
class DepthInterpolation {
 public:
  explicit DepthInterpolation(std::span<const RawMeasurements> images);
  /// Weights of the values at the two ends.
  [[nodiscard]] Eigen::Vector2d Weights(double inverse_depth) const;

 private:
  double low_ = std::numeric_limits<double>::infinity(), high_ = -low_;
};

/// Cauchy's weight of a residual at three times the root mean square. Wider than for normal errors
/// of known sigma, since the mean square is taken over residuals that have passed such weights.
double WideCauchyWeight(double residual, double mean_square);

}  // namespace plenocal::internal
