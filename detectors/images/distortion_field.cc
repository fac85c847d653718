// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/distortion_field.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <vector>

#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

/// A value that is zero but for noise and a scatter of its own.
struct Deviation {
  double square = 0, noise = 0;  ///< noise: variance
};

/// Variance of the deviations' scatter beside the noise: maximum likelihood by fixed-point steps.
double ScatterBesideNoise(const std::vector<Deviation>& deviations) {
  constexpr int kSteps =
      20;  // more than enough for a prior, of which the order of magnitude counts
  double variance = 0;
  for (int step = 0; step < kSteps; ++step) {
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

Eigen::Vector2d RadialDirection(const Eigen::Vector2d& p) {
  // In the middle itself, where no direction is any better, k_1 to k_3 are 0.
  return p.isZero(0) ? Eigen::Vector2d::UnitX() : p.normalized().eval();
}

DistortionField::TermsByLinear DistortionField::LinearJacobian(const Eigen::Vector2d& p,
                                                               const Eigen::Vector2d& axis) {
  const std::complex<double> q(p.x() - axis.x(), p.y() - axis.y());
  const Eigen::Vector2d direction = RadialDirection(p);
  const std::complex<double> rotated = q * std::complex<double>(direction.x(), -direction.y());
  const double square = std::norm(q), second = (rotated * rotated).real();
  const double fourth = (rotated * rotated * rotated * rotated).real();
  const std::complex<double> cube = q * q * q;
  TermsByLinear J = TermsByLinear::Zero();
  J(0, 0) = J(1, 1) = 1;
  // The terms of A |p + d|^2n (p + d) of second and third order in d; b and c after a homography
  // has taken away what it can.
  std::array<double, 3> power{1, 0, 0};  // |q|^2 to the n - 1, n - 2 and n - 3
  for (int n = 1; n <= kRadialOrders; ++n) {
    const double pairs = n * (n - 1) / 2.0, triples = pairs * (n - 2) / 3;
    auto column = J.col(1 + n);
    column[0] = (n + pairs) * power[0] * q.real();
    column[1] = (n + pairs) * power[0] * q.imag();
    column[2] = pairs * power[1] * cube.real();
    column[3] = pairs * power[1] * cube.imag();
    column[4] = (n + 4 * pairs + 3 * triples) * power[0];
    column[5] = 3 * (pairs + triples) * power[1] * second;
    column[6] = (pairs + triples) * power[1] * second;
    column[7] = triples * power[2] * fourth;
    power = {power[0] * square, power[0], power[1]};
  }
  double other = 1;
  for (int n = 0; n < kOtherOrders; ++n) {
    auto column = J.col(2 + kRadialOrders + n);
    column[2] = other * cube.real();
    column[3] = other * cube.imag();
    other *= square;
  }
  for (int n = 0; n < kOtherThirds; ++n) J(5 + n, kLinear - kOtherThirds + n) = second;
  return J;
}

LocalDistortion DistortionField::At(const Eigen::Vector2d& p) const {
  return LinearJacobian(p, axis()) * coefficients_.head<kLinear>();
}

DistortionField::TermsByAll DistortionField::Jacobian(const Eigen::Vector2d& p) const {
  TermsByAll J;
  J.leftCols<kLinear>() = LinearJacobian(p, axis());
  constexpr double kStep = 1e-4;  // halves of the diagonal; central differences
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(i);
    J.col(kLinear + i) = (LinearJacobian(p, axis() + step) - LinearJacobian(p, axis() - step)) *
                         coefficients_.head<kLinear>() / (2 * kStep);
  }
  return J;
}

struct DistortionField::NormalEquations {
  Covariance information = Covariance::Zero();
  Coefficients right = Coefficients::Zero();
};

DistortionField::NormalEquations DistortionField::Linearise(
    std::span<const DistortionMeasurement> measurements,
    const std::vector<double>& residuals,
    double scale) const {
  // Width of Cauchy's weights, in standard deviations: a tag that was mistaken for another gives
  // arbitrary measurements.
  constexpr double kCauchyWidth = 3;
  NormalEquations equations;
  TermsByAll jacobian;
  for (std::size_t i = 0; i < measurements.size(); ++i) {
    const DistortionMeasurement& m = measurements[i];
    if (i == 0 || m.p != measurements[i - 1].p) jacobian = Jacobian(m.p);
    const Coefficients row = jacobian.transpose() * m.along;
    const double deviation = residuals[i] / (kCauchyWidth * scale);
    const double weight = 1 / (scale * scale * m.variance * (1 + deviation * deviation));
    equations.information.noalias() += weight * row * row.transpose();
    // About the present axis.
    equations.right += weight * row * (m.value + row.tail<2>().dot(axis()));
  }
  return equations;
}

std::vector<double> DistortionField::Residuals(
    std::span<const DistortionMeasurement> measurements) const {
  std::vector<double> residuals(measurements.size());
  LocalDistortion distortion;
  for (std::size_t i = 0; i < measurements.size(); ++i) {
    const DistortionMeasurement& m = measurements[i];
    if (i == 0 || m.p != measurements[i - 1].p) distortion = At(m.p);
    residuals[i] = std::abs(m.value - m.along.dot(distortion)) / std::sqrt(m.variance);
  }
  return residuals;
}

DistortionField::DistortionField(std::span<const DistortionMeasurement> measurements) {
  std::vector<Deviation> deviations;
  for (const DistortionMeasurement& m : measurements) {
    deviations.push_back({m.value * m.value, m.variance});
  }
  const double variance = ScatterBesideNoise(deviations);
  if (variance == 0) return;
  // Prior of the coefficients: all of one size at first, then each of the size that it turns out to
  // have (empirical Bayes; D. MacKay, "Bayesian Interpolation", 1992). The axis of a real lens is
  // within some tenth of the image about its middle.
  constexpr double kAxisSigma = 0.1;  // halves of the diagonal
  Coefficients prior = Coefficients::Constant(variance);
  prior.tail<2>().setConstant(kAxisSigma * kAxisSigma);
  std::vector<double> residuals(measurements.size(), 0.0);
  double scale = 1;  // of the measurements' sigmas, for what a smooth lens does not explain
  constexpr int kRounds = 6;      // Gauss-Newton steps of the axis, and of the scale
  constexpr int kPriorSteps = 3;  // within each
  for (int round = 0; round < kRounds; ++round) {
    const NormalEquations equations = Linearise(measurements, residuals, scale);
    for (int step = 0; step < kPriorSteps; ++step) {
      Covariance all = equations.information;
      all.diagonal() += prior.cwiseInverse();
      covariance_ = all.ldlt().solve(Covariance::Identity());
      coefficients_ = covariance_ * equations.right;
      prior.head<kLinear>() = (coefficients_.cwiseAbs2() + covariance_.diagonal()).head<kLinear>();
    }
    residuals = Residuals(measurements);
    scale = std::max(1.0, kSigmaPerMad * Median(residuals));
  }
}

Eigen::Vector2d DistortionField::Change(const DistortionSensitivity& sensitivity) const {
  Eigen::Vector2d change(0, 0);
  for (const SensitivityPiece& piece : sensitivity.pieces) {
    change += piece.by_distortion * (At(piece.p) - piece.assumed);
  }
  return change;
}

Eigen::Vector2d DistortionField::HigherOrders(const DistortionSensitivity& sensitivity,
                                              const Eigen::Vector2d& p) const {
  Eigen::Vector2d by_change(0, 0);
  for (const SensitivityPiece& piece : sensitivity.pieces) {
    by_change += piece.by_distortion * (At(p) - At(piece.p));
  }
  return by_change / 2;  // mean of the terms between both places
}

double DistortionField::Sigma(const DistortionSensitivity& sensitivity) const {
  Eigen::Matrix<double, 2, kCoefficients> jacobian =
      Eigen::Matrix<double, 2, kCoefficients>::Zero();
  for (const SensitivityPiece& piece : sensitivity.pieces) {
    jacobian += piece.by_distortion * Jacobian(piece.p);
  }
  const Eigen::Matrix2d of_field = jacobian * covariance_ * jacobian.transpose();
  return std::sqrt(sensitivity.sigma * sensitivity.sigma + of_field.trace() / 2);
}

}  // namespace plenocal
