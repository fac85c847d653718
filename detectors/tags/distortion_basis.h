// SPDX-License-Identifier: Apache-2.0
//
// Displacements by the terms of a local lens distortion.
#pragma once

#include <Eigen/Core>

#include "detectors/images/distortion_field.h"
#include "detectors/templates/lanes.h"

namespace plenocal::internal {

/// One value, or as many as a vector has.
struct One {
  using Scalar = double;
  using Values = double;
};
struct Eight {
  using Scalar = float;
  using Values = Lanes;
};

/// The displacements that the terms of a local distortion c cause about one place: an ideal lens
/// would image what is at a distance d from the place at d - S(d) c, up to a homography.
class DistortionBasis {
 public:
  /// `size`: width and height of the image, px.
  DistortionBasis(const Eigen::Vector2d& place, const Eigen::Vector2d& size)
      : radius_(size.norm() / 2), p_(PlaceOfPixel(place, size)) {
    const Eigen::Vector2d e = RadialDirection(p_);
    second_ = {e.x() * e.x() - e.y() * e.y(), 2 * e.x() * e.y()};
    fourth_ = {second_.x() * second_.x() - second_.y() * second_.y(),
               2 * second_.x() * second_.y()};
  }

  [[nodiscard]] const Eigen::Vector2d& p() const { return p_; }

  /// S at d = (d_x, d_y), px.
  template <typename Kind>
  struct Displacements {
    typename Kind::Values x[kDistortionTerms], y[kDistortionTerms];
  };
  template <typename Kind>
  PLENOCAL_LANES void At(const typename Kind::Values& d_x,
                         const typename Kind::Values& d_y,
                         Displacements<Kind>* displacement) const {
    using Scalar = typename Kind::Scalar;
    using Values = typename Kind::Values;
    const auto radius = static_cast<Scalar>(radius_), by_px = 1 / radius;
    const auto c_2 = static_cast<Scalar>(second_.x()), s_2 = static_cast<Scalar>(second_.y());
    const auto c_4 = static_cast<Scalar>(fourth_.x()), s_4 = static_cast<Scalar>(fourth_.y());
    const Values x = d_x * by_px, y = d_y * by_px;
    const Values u = radius * (x * x - y * y), v = radius * 2 * x * y;  // d^2
    const Values square = radius * (x * x + y * y);
    const Values cube_u = u * x - v * y, cube_v = u * y + v * x;
    const auto put = [&](int i, const Values& shift_x, const Values& shift_y) {
      displacement->x[i] = shift_x;
      displacement->y[i] = shift_y;
    };
    put(0, square, Values{});
    put(1, Values{}, square);
    put(2, u, -v);
    put(3, v, u);
    put(4, square * x, square * y);
    put(5, square * (c_2 * x + s_2 * y), square * (s_2 * x - c_2 * y));
    put(6, c_2 * cube_u + s_2 * cube_v, c_2 * cube_v - s_2 * cube_u);
    put(7, c_4 * cube_u + s_4 * cube_v, s_4 * cube_u - c_4 * cube_v);
  }
  [[nodiscard]] Eigen::Matrix<double, 2, kDistortionTerms> At(const Eigen::Vector2d& d) const {
    Displacements<One> displacement;
    At<One>(d.x(), d.y(), &displacement);
    Eigen::Matrix<double, 2, kDistortionTerms> S;
    for (int i = 0; i < kDistortionTerms; ++i) S.col(i) << displacement.x[i], displacement.y[i];
    return S;
  }

  /// Curvature of the image of a straight edge through the place that goes `half_edge` (px) to
  /// either side: at a distance d along the edge it is displaced by this . c d^2 (px) in the
  /// direction `normal` (of length 1).
  [[nodiscard]] LocalDistortion EdgeCurvature(const Eigen::Vector2d& half_edge,
                                              const Eigen::Vector2d& normal) const {
    return (At(half_edge) + At(-half_edge)).transpose() * normal / (2 * half_edge.squaredNorm());
  }

 private:
  double radius_;
  Eigen::Vector2d p_;
  Eigen::Vector2d second_, fourth_;  // powers of the direction
};

}  // namespace plenocal::internal
