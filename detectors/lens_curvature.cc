// SPDX-License-Identifier: Apache-2.0
#include "detectors/lens_curvature.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

namespace plenocal {
namespace {

struct Deviation {
  double square = 0, noise = 0;  ///< noise: variance
};

/// Variance of what has these deviations beside the noise: maximum likelihood by fixed-point steps.
double Variance(const std::vector<Deviation>& deviations) {
  double variance = 0;
  for (int iteration = 0; iteration < 20; ++iteration) {
    double sum = 0, weight_sum = 0;
    for (const auto& [square, noise] : deviations) {
      const double weight = 1 / ((noise + variance) * (noise + variance));
      sum += weight * (square - noise);
      weight_sum += weight;
    }
    if (weight_sum == 0) return 0;
    variance = std::max(0.0, sum / weight_sum);
  }
  return variance;
}

}  // namespace

LensCurvature::LensCurvature(std::span<const LensReading> readings) {
  using Matrix = Eigen::Matrix<double, kLensShapes, kLensShapes>;
  std::vector<Deviation> deviations;
  for (const LensReading& r : readings) deviations.push_back({r.value * r.value, r.variance});
  const double variance = plenocal::Variance(deviations);
  if (variance == 0) return;
  // What the coefficients are like before any reading: of one size, and then of the size that they
  // turn out to have (empirical Bayes; D. MacKay, "Bayesian Interpolation", 1992). Once without and
  // once with what a smooth lens leaves over.
  LensShape prior = LensShape::Constant(variance);
  double rest = 0;
  for (int round = 0; round < 2; ++round) {
    Matrix information = Matrix::Zero();
    LensShape sum = LensShape::Zero();
    for (const LensReading& r : readings) {
      information += r.along * r.along.transpose() / (r.variance + rest);
      sum += r.along * r.value / (r.variance + rest);
    }
    for (int step = 0; step < 10; ++step) {
      Matrix all = information;
      all.diagonal() += prior.cwiseInverse();
      covariance_ = all.ldlt().solve(Matrix::Identity());
      shape_ = covariance_ * sum;
      prior = shape_.cwiseAbs2() + covariance_.diagonal();
    }
    deviations.clear();
    for (const LensReading& r : readings) {
      const double deviation = r.value - r.along.dot(shape_);
      deviations.push_back({deviation * deviation, r.variance});
    }
    rest = plenocal::Variance(deviations);
  }
}

Eigen::Vector2d LensCurvature::Change(const BentMarker& bent) const {
  return bent.by_shape * (shape_ - bent.shape);
}

double LensCurvature::Sigma(const BentMarker& bent) const {
  const Eigen::Matrix2d of_shape = bent.by_shape * covariance_ * bent.by_shape.transpose();
  return std::sqrt(bent.sigma * bent.sigma + of_shape.trace() / 2);
}

double LensCurvature::Variance(const LensShape& row) const { return row.dot(covariance_ * row); }

}  // namespace plenocal
