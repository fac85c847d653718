// SPDX-License-Identifier: Apache-2.0
//
// Smooth functions over an image: cubic splines, their fit and their values by pixel.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <opencv2/core/mat.hpp>

#include "calib/base/parallel.h"
#include "calib/camera/observation.h"

namespace plenocal {

/// Cubic B-splines over an image, with uniform knots.
class ImageSpline {
 public:
  static constexpr int kSupport = 16;  ///< coefficients with an effect at one position
  /// These coefficients and their weights, which add up to 1.
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

/// Least squares for the coefficients from values at positions of the image. Where there are none
/// the curvature is small.
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

/// Variance of the spline's value at a position.
double VarianceAt(const ImageSpline::Basis& basis, const Eigen::MatrixXd& covariance);

/// The image (CV_32F) of value(x, y) at each of its pixels.
template <typename Value>
cv::Mat MakeImage(const cv::Size& size, int threads, const Value& value) {
  cv::Mat image(size, CV_32F);
  ParallelFor(static_cast<std::size_t>(size.height), threads, [&](std::size_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < size.width; ++x) image.at<float>(y, x) = static_cast<float>(value(x, y));
  });
  return image;
}

/// The attenuation (CV_32F, largest value 1) whose logarithm is the spline, up to a factor.
cv::Mat MakeAttenuation(const ImageSpline& spline,
                        const Eigen::VectorXd& coefficients,
                        const ImageSize& size,
                        int threads);

}  // namespace plenocal
