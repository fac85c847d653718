// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

namespace plenocal {

/// A lens' distortion as far as it bends straight lines, a_x, a_y, A_0, A_1...: what is at p would
/// without it be at p less
///
///   a |p|^2 + p (A_0 |p|^2 + A_1 |p|^4 + ...),
///
/// or at a projective image of that; p is counted from the image's middle in halves of its
/// diagonal. a is for a lens whose axis is elsewhere: to second order about each place that is all
/// that decentring does.
inline constexpr int kRadialOrders = 5;
inline constexpr int kLensShapes = 2 + kRadialOrders;
using LensShape = Eigen::Matrix<double, kLensShapes, 1>;

/// What a piece of an image says about the lens' shape: the value of `along` . shape, near the
/// shape that was assumed.
struct LensReading {
  LensShape along;  ///< of length 1
  double value = 0;
  double variance = 0;  ///< of value, from the noise
};

/// How a marker, measured among bent lines, moves with the lens' shape assumed for them.
struct BentMarker {
  LensShape shape;                                 ///< assumed
  Eigen::Matrix<double, 2, kLensShapes> by_shape;  ///< px
  double sigma = 0;                                ///< px, of each coordinate, were the shape exact
};

/// The bending that a lens does to straight lines, learned from its images. Few readings, or
/// uncertain ones, say little and leave the shape near 0.
class LensCurvature {
 public:
  explicit LensCurvature(std::span<const LensReading> readings);

  [[nodiscard]] const LensShape& shape() const { return shape_; }

  /// How far a marker moves with the shape that is known now, px.
  [[nodiscard]] Eigen::Vector2d Change(const BentMarker& bent) const;

  /// Sigma of each of its coordinates then, px.
  [[nodiscard]] double Sigma(const BentMarker& bent) const;

  /// Variance of `row` . shape.
  [[nodiscard]] double Variance(const LensShape& row) const;

 private:
  LensShape shape_ = LensShape::Zero();
  Eigen::Matrix<double, kLensShapes, kLensShapes> covariance_ =
      Eigen::Matrix<double, kLensShapes, kLensShapes>::Zero();
};

}  // namespace plenocal
