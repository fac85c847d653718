// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "calib/camera/observation.h"

namespace plenocal {

/// Cubic B-splines over an image (uniform knots; C. de Boor, "A Practical Guide to Splines", 1978).
class ImageSpline {
 public:
  static constexpr int kSupport = 16;  ///< coefficients that have an effect at one place
  /// Those at one place, and their weights, which add up to 1.
  struct Basis {
    std::array<int, kSupport> index;
    std::array<float, kSupport> weight;
  };

  /// `spacing`: px between knots; made a little smaller so that knots are at the image's borders.
  ImageSpline(const ImageSize& size, double spacing);

  [[nodiscard]] int Columns() const { return cells_[0] + 3; }
  [[nodiscard]] int Coefficients() const { return Columns() * (cells_[1] + 3); }
  /// At pixel (x, y) of the image.
  [[nodiscard]] Basis At(double x, double y) const;
  [[nodiscard]] double Evaluate(const Eigen::VectorXd& coefficients, double x, double y) const;

 private:
  std::array<int, 2> cells_{};
  std::array<double, 2> scale_{};  // cells per px
};

/// That of a vignetting: 40 cells along the longer side.
ImageSpline MakeAttenuationSpline(const ImageSize& size);

/// Least squares for the coefficients from values at places of the image. Where there are none the
/// spline is hardly bent.
class SplineFit {
 public:
  /// `spline` must outlive the object.
  explicit SplineFit(const ImageSpline& spline);
  /// `weight`: 1 / variance of the value.
  void Add(double x, double y, double value, double weight);
  /// REQUIRES: a value.
  [[nodiscard]] Eigen::VectorXd Solve() const;
  [[nodiscard]] Eigen::MatrixXd Covariance() const;

 private:
  [[nodiscard]] Eigen::MatrixXd Normal() const;

  const ImageSpline& spline_;
  Eigen::MatrixXd N_;
  Eigen::VectorXd b_;
};

/// Variance of the spline's value at a place.
double VarianceAt(const ImageSpline::Basis& basis, const Eigen::MatrixXd& covariance);

}  // namespace plenocal
