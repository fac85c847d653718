// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/images/image_spline.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "calib/base/cubic_spline.h"

namespace plenocal {
ImageSpline::ImageSpline(const ImageSize& size, double spacing) {
  for (size_t axis = 0; axis < 2; ++axis) {
    cells_[axis] = std::max(1, static_cast<int>(std::ceil(size[axis] / spacing)));
    scale_[axis] = cells_[axis] / static_cast<double>(size[axis]);
  }
}

ImageSpline::Basis ImageSpline::At(double x, double y) const {
  const std::array<double, 2> place{(x + 0.5) * scale_[0], (y + 0.5) * scale_[1]};
  std::array<int, 2> cell{};
  std::array<std::array<double, 4>, 2> weights{};
  for (size_t axis = 0; axis < 2; ++axis) {
    cell[axis] = std::clamp(static_cast<int>(std::floor(place[axis])), 0, cells_[axis] - 1);
    weights[axis] = CubicBSplines(place[axis] - cell[axis]);
  }
  Basis basis{};
  const int stride = cells_[0] + 3;
  for (int j = 0; j < 4; ++j) {
    for (int i = 0; i < 4; ++i) {
      const size_t k = 4 * static_cast<size_t>(j) + static_cast<size_t>(i);
      basis.index[k] = (cell[1] + j) * stride + cell[0] + i;
      basis.weight[k] = static_cast<float>(weights[0][static_cast<size_t>(i)] *
                                           weights[1][static_cast<size_t>(j)]);
    }
  }
  return basis;
}

double ImageSpline::Evaluate(const Eigen::VectorXd& coefficients, double x, double y) const {
  const Basis basis = At(x, y);
  double sum = 0;
  for (size_t k = 0; k < kSupport; ++k) sum += basis.weight[k] * coefficients[basis.index[k]];
  return sum;
}

ImageSpline MakeAttenuationSpline(const ImageSize& size) {
  constexpr double kCells = 40;
  return {size, std::max(size[0], size[1]) / kCells};
}

SplineFit::SplineFit(const ImageSpline& spline)
    : spline_(spline),
      N_(Eigen::MatrixXd::Zero(spline.Coefficients(), spline.Coefficients())),
      b_(Eigen::VectorXd::Zero(spline.Coefficients())) {}

void SplineFit::Add(double x, double y, double value, double weight) {
  const ImageSpline::Basis basis = spline_.At(x, y);
  for (size_t i = 0; i < ImageSpline::kSupport; ++i) {
    const double w = weight * basis.weight[i];
    b_[basis.index[i]] += w * value;
    for (size_t j = 0; j < ImageSpline::kSupport; ++j) {
      N_(basis.index[j], basis.index[i]) += w * basis.weight[j];
    }
  }
}

Eigen::MatrixXd SplineFit::Normal() const {
  constexpr double kHardly = 1e-4;  // of the information of the values
  const Eigen::Vector3d second_difference(1, -2, 1);
  const Eigen::Matrix3d bend =
      kHardly * N_.diagonal().mean() * second_difference * second_difference.transpose();
  Eigen::MatrixXd N = N_;
  const Eigen::Index columns = spline_.Columns();
  const auto add_bend = [&](Eigen::Index first, Eigen::Index step) {
    const auto three = Eigen::seqN(first, 3, step);
    N(three, three) += bend;
  };
  for (Eigen::Index i = 0; i < N.rows(); ++i) {
    if (i % columns + 2 < columns) add_bend(i, 1);
    if (i + 2 * columns < N.rows()) add_bend(i, columns);
  }
  return N;
}

Eigen::VectorXd SplineFit::Solve() const { return Eigen::LLT<Eigen::MatrixXd>(Normal()).solve(b_); }

Eigen::MatrixXd SplineFit::Covariance() const {
  return Eigen::LLT<Eigen::MatrixXd>(Normal()).solve(
      Eigen::MatrixXd::Identity(N_.rows(), N_.cols()));
}

double VarianceAt(const ImageSpline::Basis& basis, const Eigen::MatrixXd& covariance) {
  double sum = 0;
  for (size_t i = 0; i < ImageSpline::kSupport; ++i) {
    for (size_t j = 0; j < ImageSpline::kSupport; ++j) {
      sum += static_cast<double>(basis.weight[i]) * basis.weight[j] *
             covariance(basis.index[i], basis.index[j]);
    }
  }
  return sum;
}

cv::Mat MakeAttenuation(const ImageSpline& spline,
                        const Eigen::VectorXd& coefficients,
                        const ImageSize& size,
                        int threads) {
  cv::Mat values = MakeImage({size[0], size[1]}, threads, [&](int x, int y) {
    return spline.Evaluate(coefficients, x, y);
  });
  double largest = 0;
  cv::minMaxLoc(values, nullptr, &largest);
  cv::exp(values - largest, values);
  return values;
}

}  // namespace plenocal
