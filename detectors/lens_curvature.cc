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

LensCurvature::LensCurvature(std::span<const BentEdge> edges, const Eigen::Vector2d& size)
    : middle_((size - Eigen::Vector2d::Ones()) / 2), radius_(size.norm() / 2) {
  coefficients_.setZero();
  covariance_.setZero();
  std::vector<Deviation> deviations;
  for (const BentEdge& e : edges) deviations.push_back({e.bend * e.bend, e.variance});
  const double variance = plenocal::Variance(deviations);
  if (variance == 0) return;
  // Once without and once with what a smooth c leaves over.
  for (int round = 0; round < 2; ++round) {
    covariance_ = Eigen::Matrix4d::Identity() / variance;
    coefficients_.setZero();
    for (const BentEdge& e : edges) {
      const Eigen::Vector4d row = Row(e.place, e.normal);
      covariance_ += row * row.transpose() / (e.variance + rest_);
      coefficients_ += row * e.bend / (e.variance + rest_);
    }
    covariance_ = covariance_.ldlt().solve(Eigen::Matrix4d::Identity()).eval();
    coefficients_ = (covariance_ * coefficients_).eval();
    deviations.clear();
    for (const BentEdge& e : edges) {
      const double rest = e.bend - e.normal.dot(At(e.place));
      deviations.push_back({rest * rest, e.variance});
    }
    rest_ = plenocal::Variance(deviations);
  }
}

Eigen::Vector4d LensCurvature::Row(const Eigen::Vector2d& place,
                                   const Eigen::Vector2d& normal) const {
  const Eigen::Vector2d p = (place - middle_) / radius_;
  const double along = normal.dot(p);
  return {normal.x(), normal.y(), along, along * p.squaredNorm()};
}

Eigen::Vector2d LensCurvature::At(const Eigen::Vector2d& place) const {
  return {coefficients_.dot(Row(place, Eigen::Vector2d::UnitX())),
          coefficients_.dot(Row(place, Eigen::Vector2d::UnitY()))};
}

double LensCurvature::Growth(const Eigen::Vector2d& place) const {
  const Eigen::Vector2d p = (place - middle_) / radius_;
  return (coefficients_[2] + 2 * coefficients_[3] * p.squaredNorm()) / radius_;
}

Eigen::Vector2d LensCurvature::Change(const BentMarker& bent) const {
  return bent.by_curvature * (At(bent.place) - bent.curvature) +
         bent.by_growth * (Growth(bent.place) - bent.growth);
}

double LensCurvature::Variance(const Eigen::Vector2d& place, const Eigen::Vector2d& normal) const {
  const Eigen::Vector4d row = Row(place, normal);
  return row.dot(covariance_ * row);
}

}  // namespace plenocal
