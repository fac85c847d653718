// SPDX-License-Identifier: Apache-2.0
//
// A parameter block of Ceres with a unit for each estimated number.
#pragma once

#include <ceres/manifold.h>

#include <Eigen/Core>
#include <algorithm>
#include <utility>
#include <vector>

namespace plenocal::internal {

/// Some numbers of a parameter block, each in a unit of its own; the others are constant.
class ScaledManifold : public ceres::Manifold {
 public:
  struct Part {
    int index = 0;     ///< in the block
    double scale = 1;  ///< the unit
  };

  ScaledManifold(int size, std::vector<Part> parts) : size_(size), parts_(std::move(parts)) {}

  [[nodiscard]] int AmbientSize() const override { return size_; }
  [[nodiscard]] int TangentSize() const override { return static_cast<int>(parts_.size()); }

  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    std::copy_n(x, size_, x_plus_delta);
    for (const Part& part : parts_) x_plus_delta[part.index] += part.scale * *delta++;
    return true;
  }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    RowMajor J(jacobian, AmbientSize(), TangentSize());
    J.setZero();
    for (int k = 0; k < TangentSize(); ++k) J(Of(k).index, k) = Of(k).scale;
    return true;
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    for (const Part& part : parts_) {
      *y_minus_x++ = (y[part.index] - x[part.index]) / part.scale;
    }
    return true;
  }
  bool MinusJacobian(const double* /*x*/, double* jacobian) const override {
    RowMajor J(jacobian, TangentSize(), AmbientSize());
    J.setZero();
    for (int k = 0; k < TangentSize(); ++k) J(k, Of(k).index) = 1 / Of(k).scale;
    return true;
  }

 private:
  using RowMajor =
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

  [[nodiscard]] const Part& Of(int k) const { return parts_[static_cast<size_t>(k)]; }

  int size_;
  std::vector<Part> parts_;
};

}  // namespace plenocal::internal
