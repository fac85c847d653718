// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>

namespace plenocal {

/// How a lens bends straight lines: a_x, a_y, A_0, A_1..., g_0, g_1...
///
/// A homography can undo all that a lens does about a place p to first order, and of second order
/// all but two shifts of what is at a distance d from p: in complex numbers b |d|^2 and c
/// conj(d)^2. A lens with an axis of symmetry has b along p and c along p^3, by two functions of
/// |p|^2. Those of a weak radial distortion p (A_0 |p|^2 + A_1 |p|^4 + ...) belong together; g_0
/// p^3 + g_1 |p|^2 p^3 is what c has beside it, for a lens that is not weak. a is added to b, for
/// an axis that is not in the image's middle. Beyond second order the lens does what the A_n do. p
/// and d are counted in halves of the image's diagonal, p from its middle. No ray is needed, so
/// that this holds for fisheyes too.
inline constexpr int kRadialOrders = 5, kOtherOrders = 2;
inline constexpr int kLensShapes = 2 + kRadialOrders + kOtherOrders;
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
