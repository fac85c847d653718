// SPDX-License-Identifier: Apache-2.0
#include "detectors/lens_curvature.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "calib/median.h"

namespace plenocal {
namespace {

struct Deviation {
  double square = 0, noise = 0;  ///< noise: variance
};

/// Variance of what has these deviations beside the noise: maximum likelihood by fixed-point steps.
double SpreadBeside(const std::vector<Deviation>& deviations) {
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
  const double variance = SpreadBeside(deviations);
  if (variance == 0) return;
  // What the coefficients are like before any reading: of one size, and then of the size that they
  // turn out to have (empirical Bayes; D. MacKay, "Bayesian Interpolation", 1992).
  LensShape prior = LensShape::Constant(variance);
  std::vector<double> in_sigmas(readings.size(), 0.0);
  double scale = 1;  // of the readings' sigmas, for what a smooth lens leaves over
  constexpr int kRounds = 5;
  for (int round = 0; round < kRounds; ++round) {
    Matrix information = Matrix::Zero();
    LensShape sum = LensShape::Zero();
    for (std::size_t i = 0; i < readings.size(); ++i) {
      const LensReading& r = readings[i];
      // Cauchy's: a tag that is not what it was taken for says anything.
      constexpr double kUsual = 3;
      const double deviation = in_sigmas[i] / (kUsual * scale);
      const double weight = 1 / (scale * scale * r.variance * (1 + deviation * deviation));
      information += weight * r.along * r.along.transpose();
      sum += weight * r.along * r.value;
    }
    for (int step = 0; step < 10; ++step) {
      Matrix all = information;
      all.diagonal() += prior.cwiseInverse();
      covariance_ = all.ldlt().solve(Matrix::Identity());
      shape_ = covariance_ * sum;
      prior = shape_.cwiseAbs2() + covariance_.diagonal();
    }
    std::transform(readings.begin(), readings.end(), in_sigmas.begin(), [&](const LensReading& r) {
      return std::abs(r.value - r.along.dot(shape_)) / std::sqrt(r.variance);
    });
    constexpr double kSigmaPerMedian = 1.4826;
    scale = std::max(1.0, kSigmaPerMedian * Median(in_sigmas));
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
