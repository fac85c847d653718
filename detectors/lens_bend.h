// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "detectors/lanes.h"
#include "detectors/lens_curvature.h"

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

/// How a lens bends what is about one place of its image: without it, what is at a distance d from
/// the place would be at d - S(d) c, or at a projective image of that; c is the lens' shape.
class LensBend {
 public:
  /// `size`: width and height of the image, px.
  LensBend(const Eigen::Vector2d& place, const Eigen::Vector2d& size)
      : radius_(size.norm() / 2), p_((place - (size - Eigen::Vector2d::Ones()) / 2) / radius_) {}

  /// S at d = (d_x, d_y), px.
  template <typename Kind>
  struct Shifts {
    typename Kind::Values x[kLensShapes], y[kLensShapes];
  };
  template <typename Kind>
  PLENOCAL_LANES void At(const typename Kind::Values& d_x,
                         const typename Kind::Values& d_y,
                         Shifts<Kind>* shifts) const {
    using Scalar = typename Kind::Scalar;
    using Values = typename Kind::Values;
    const auto radius = static_cast<Scalar>(radius_), by_px = 1 / radius;
    const auto p_x = static_cast<Scalar>(p_.x()), p_y = static_cast<Scalar>(p_.y());
    const Scalar from = p_x * p_x + p_y * p_y;
    const Values x = d_x * by_px, y = d_y * by_px;
    const Values square = x * x + y * y;
    const Values more = 2 * (p_x * x + p_y * y) + square;  // of |p|^2
    const auto put = [&](int i, const Values& shift_x, const Values& shift_y) {
      shifts->x[i] = radius * shift_x;
      shifts->y[i] = radius * shift_y;
    };
    put(0, square, Values{});
    put(1, Values{}, square);
    // Of |p|^2n: its change, and that without what is linear in `more`.
    Values change = more, rest{};
    Scalar power = 1;  // |p|^(2n - 2) at the place
    for (int n = 1; n <= kRadialOrders; ++n) {
      const Values curved = static_cast<Scalar>(n) * power * square + rest;
      put(n + 1, curved * p_x + change * x, curved * p_y + change * y);
      rest = from * rest + change * more;
      power *= from;
      change = change * (from + more) + power * more;
    }
    // p^3 conj(d)^2
    const Scalar cube_x = p_x * (p_x * p_x - 3 * p_y * p_y);
    const Scalar cube_y = p_y * (3 * p_x * p_x - p_y * p_y);
    const Values real = x * x - y * y, imaginary = -2 * x * y;
    power = 1;
    for (int i = 2 + kRadialOrders; i < kLensShapes; ++i) {
      put(i,
          power * (cube_x * real - cube_y * imaginary),
          power * (cube_x * imaginary + cube_y * real));
      power *= from;
    }
  }
  [[nodiscard]] Eigen::Matrix<double, 2, kLensShapes> At(const Eigen::Vector2d& d) const {
    Shifts<One> shifts;
    At<One>(d.x(), d.y(), &shifts);
    Eigen::Matrix<double, 2, kLensShapes> S;
    for (int i = 0; i < kLensShapes; ++i) S.col(i) << shifts.x[i], shifts.y[i];
    return S;
  }

  /// An edge through the place, straight on the target, that goes `half_edge` (px) to either side
  /// is bent by this . shape d^2 (px) in the direction `normal` (of length 1) at a distance d along
  /// it.
  [[nodiscard]] LensShape OfEdge(const Eigen::Vector2d& half_edge,
                                 const Eigen::Vector2d& normal) const {
    return (At(half_edge) + At(-half_edge)).transpose() * normal / (2 * half_edge.squaredNorm());
  }

 private:
  double radius_;
  Eigen::Vector2d p_;
};

}  // namespace plenocal::internal
