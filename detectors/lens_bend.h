// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <array>

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

/// How a lens of some shape bends what is about one place of its image: without it, what is at a
/// distance d from the place would be at d - B(d), or at an affine image of that. Where the shape
/// says s(d), of which J d is the linear part, B is d - J^-1 s(d).
class LensBend {
 public:
  /// `size`: width and height of the image, px.
  LensBend(const LensShape& shape, const Eigen::Vector2d& place, const Eigen::Vector2d& size)
      : shape_(shape),
        radius_(size.norm() / 2),
        p_((place - (size - Eigen::Vector2d::Ones()) / 2) / radius_) {
    const double square = p_.squaredNorm();
    linear_[0] << 2 * p_.transpose(), 0, 0;
    linear_[1] << 0, 0, 2 * p_.transpose();
    Eigen::Matrix2d by_factor = 2 * p_ * p_.transpose();
    double power = square;
    for (int n = 1; n <= kRadialOrders; ++n) {
      linear_[n + 1] = power * Eigen::Matrix2d::Identity() + by_factor * n;
      by_factor *= square;
      power *= square;
    }
    Eigen::Matrix2d J = Eigen::Matrix2d::Identity();
    for (int i = 0; i < kLensShapes; ++i) J -= shape[i] * linear_[i];
    inverse_ = J.inverse();
    for (Eigen::Matrix2d& linear : linear_) linear = (inverse_ * linear).eval();
  }

  /// B at d = (d_x, d_y), px, and its derivatives by the shape, px.
  template <typename Kind>
  struct Bent {
    typename Kind::Values x, y, by_shape_x[kLensShapes], by_shape_y[kLensShapes];
  };
  template <typename Kind>
  PLENOCAL_LANES void At(const typename Kind::Values& d_x,
                         const typename Kind::Values& d_y,
                         Bent<Kind>* bent) const {
    using Scalar = typename Kind::Scalar;
    using Values = typename Kind::Values;
    const auto radius = static_cast<Scalar>(radius_), by_px = 1 / radius;
    const auto p_x = static_cast<Scalar>(p_.x()), p_y = static_cast<Scalar>(p_.y());
    const Scalar from = p_x * p_x + p_y * p_y;
    const Values x = d_x * by_px, y = d_y * by_px;
    const Values square = x * x + y * y;
    const Values more = 2 * (p_x * x + p_y * y) + square;  // of |p|^2
    // What is not linear in d, first of the shape's own terms.
    const auto put = [&](int i, const Values& of_x, const Values& of_y) {
      const Eigen::Matrix<Scalar, 2, 2> inverse = inverse_.template cast<Scalar>() * radius;
      bent->by_shape_x[i] = inverse(0, 0) * of_x + inverse(0, 1) * of_y;
      bent->by_shape_y[i] = inverse(1, 0) * of_x + inverse(1, 1) * of_y;
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
    bent->x = bent->y = Values{};
    for (int i = 0; i < kLensShapes; ++i) {
      bent->x += static_cast<Scalar>(shape_[i]) * bent->by_shape_x[i];
      bent->y += static_cast<Scalar>(shape_[i]) * bent->by_shape_y[i];
    }
    // J changes too.
    for (int i = 0; i < kLensShapes; ++i) {
      const Eigen::Matrix<Scalar, 2, 2> linear = linear_[i].template cast<Scalar>();
      bent->by_shape_x[i] += linear(0, 0) * bent->x + linear(0, 1) * bent->y;
      bent->by_shape_y[i] += linear(1, 0) * bent->x + linear(1, 1) * bent->y;
    }
  }
  [[nodiscard]] Eigen::Vector2d At(const Eigen::Vector2d& d) const {
    Bent<One> bent;
    At<One>(d.x(), d.y(), &bent);
    return {bent.x, bent.y};
  }
  [[nodiscard]] Eigen::Matrix<double, 2, kLensShapes> ByShape(const Eigen::Vector2d& d) const {
    Bent<One> bent;
    At<One>(d.x(), d.y(), &bent);
    Eigen::Matrix<double, 2, kLensShapes> by_shape;
    for (int i = 0; i < kLensShapes; ++i) {
      by_shape.col(i) << bent.by_shape_x[i], bent.by_shape_y[i];
    }
    return by_shape;
  }

 private:
  LensShape shape_;
  double radius_;
  Eigen::Vector2d p_;
  Eigen::Matrix2d inverse_;                          ///< of J
  std::array<Eigen::Matrix2d, kLensShapes> linear_;  ///< J^-1 times what each shape adds to J
};

/// An edge through a place, straight on the target, that goes some way to either side is bent by
/// `bend` d^2 (px) in the direction of its normal at a distance d along it.
struct EdgeBend {
  /// `half_edge`: px, along the edge; `normal`: of length 1.
  EdgeBend(const LensBend& lens, const Eigen::Vector2d& half_edge, const Eigen::Vector2d& normal)
      : bend((lens.At(half_edge) + lens.At(-half_edge)).dot(normal) /
             (2 * half_edge.squaredNorm())),
        by_shape((lens.ByShape(half_edge) + lens.ByShape(-half_edge)).transpose() * normal /
                 (2 * half_edge.squaredNorm())) {}

  double bend;         ///< 1/px
  LensShape by_shape;  ///< 1/px
};

}  // namespace plenocal::internal
