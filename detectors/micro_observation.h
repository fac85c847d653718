// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <limits>
#include <span>
#include <vector>

#include "calib/observation.h"

namespace plenocal::internal {

/// A marker measured in one micro image, with what its place depends on.
struct MicroObservation {
  Observation seen;          ///< x, y, lens_x, lens_y
  double inverse_depth = 0;  ///< 1 / v, as the drawing of the target had it that was fitted
  /// Change of (x, y) with the displacements of detectors/vignetting_shift.h, 1 / px.
  Eigen::Matrix2d pull = Eigen::Matrix2d::Zero();
  /// Change of (x, y), px, with ln v under the drawing.
  Eigen::Vector2d by_depth{0, 0};
  int type = 0;  ///< of the micro lens

  [[nodiscard]] Eigen::Vector2d Place() const { return {seen.values[0], seen.values[1]}; }
  [[nodiscard]] Eigen::Vector2d Centre() const { return {seen.values[2], seen.values[3]}; }
  /// u_0 of x = u_0 + s c, for s = 1 - 1 / v (models/start/plenoptic_points.h): the same in all
  /// micro images of the marker, if v is right.
  [[nodiscard]] Eigen::Vector2d U0() const { return Place() - Centre() * (1 - inverse_depth); }
  /// Change of `U0` with the true 1 / v, but for one that all micro images of the marker share;
  /// x is measured with the drawing for another v.
  [[nodiscard]] Eigen::Vector2d U0ByInverseDepth() const {
    return by_depth / inverse_depth - Centre();
  }
  void Move(const Eigen::Vector2d& by) {
    seen.values[0] += by.x();
    seen.values[1] += by.y();
  }
};

/// The markers of one raw image by ascending number.
using MicroView = std::vector<MicroObservation>;

/// The observations of each marker in each view, where they are more than two: they have three
/// unknowns of their own, place and depth; the more beyond, the more they say.
std::vector<std::span<const MicroObservation>> RunsOf(std::span<const MicroView> views);

/// What changes linearly with inverse virtual depth is on the line through its values at the
/// nearest and the farthest marker.
class DepthLine {
 public:
  explicit DepthLine(std::span<const MicroView> views);
  /// Weights of the two values.
  [[nodiscard]] Eigen::Vector2d At(double inverse_depth) const;

 private:
  double low_ = std::numeric_limits<double>::infinity(), high_ = -low_;
};

/// Cauchy's weight for a residual, three typical lengths wide.
double CauchyWeight(double residual, double mean_square);

}  // namespace plenocal::internal
