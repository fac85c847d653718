// SPDX-License-Identifier: Apache-2.0
#include "detectors/lens_curvature.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
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

Eigen::Vector2d BendDirection(const Eigen::Vector2d& p) {
  // In the middle itself, where no direction is any better, k_1 to k_3 are 0.
  return p.isZero(0) ? Eigen::Vector2d::UnitX() : p.normalized().eval();
}

LensCurvature::ByCoefficients LensCurvature::BendsByCoefficients(const Eigen::Vector2d& p,
                                                                 const Eigen::Vector2d& axis) {
  const std::complex<double> q(p.x() - axis.x(), p.y() - axis.y());
  const Eigen::Vector2d direction = BendDirection(p);
  const std::complex<double> turned = q * std::complex<double>(direction.x(), -direction.y());
  const double square = std::norm(q), second = (turned * turned).real();
  const double fourth = (turned * turned * turned * turned).real();
  const std::complex<double> cube = q * q * q;
  ByCoefficients J = ByCoefficients::Zero();
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
  for (int n = 0; n < kOtherThirds; ++n) J(5 + n, kCoefficients - kOtherThirds + n) = second;
  return J;
}

LensBends LensCurvature::At(const Eigen::Vector2d& p) const {
  return BendsByCoefficients(p, axis()) * lens_.head<kCoefficients>();
}

LensCurvature::ByLens LensCurvature::BendsByLens(const Eigen::Vector2d& p) const {
  ByLens J;
  J.leftCols<kCoefficients>() = BendsByCoefficients(p, axis());
  constexpr double kStep = 1e-4;
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(i);
    J.col(kCoefficients + i) =
        (BendsByCoefficients(p, axis() + step) - BendsByCoefficients(p, axis() - step)) *
        lens_.head<kCoefficients>() / (2 * kStep);
  }
  return J;
}

LensCurvature::LensCurvature(std::span<const LensReading> readings) {
  using Matrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  std::vector<Deviation> deviations;
  for (const LensReading& r : readings) deviations.push_back({r.value * r.value, r.variance});
  const double variance = SpreadBeside(deviations);
  if (variance == 0) return;
  // What the coefficients are like before any reading: of one size, and then of the size that they
  // turn out to have (empirical Bayes; D. MacKay, "Bayesian Interpolation", 1992). The axis is
  // within some tenth of the image about its middle.
  constexpr double kAxisSigma = 0.1;
  Lens prior = Lens::Constant(variance);
  prior.tail<2>().setConstant(kAxisSigma * kAxisSigma);
  std::vector<double> in_sigmas(readings.size(), 0.0);
  double scale = 1;  // of the readings' sigmas, for what a smooth lens leaves over
  constexpr int kRounds = 6;
  for (int round = 0; round < kRounds; ++round) {
    Matrix information = Matrix::Zero();
    Lens sum = Lens::Zero();
    ByLens by_lens;
    for (std::size_t i = 0; i < readings.size(); ++i) {
      const LensReading& r = readings[i];
      if (i == 0 || r.p != readings[i - 1].p) by_lens = BendsByLens(r.p);
      const Lens row = by_lens.transpose() * r.along;
      // Cauchy's: a tag that is not what it was taken for says anything.
      constexpr double kUsual = 3;
      const double deviation = in_sigmas[i] / (kUsual * scale);
      const double weight = 1 / (scale * scale * r.variance * (1 + deviation * deviation));
      information.noalias() += weight * row * row.transpose();
      // About the present axis.
      sum += weight * row * (r.value + row.tail<2>().dot(axis()));
    }
    for (int step = 0; step < 3; ++step) {
      Matrix all = information;
      all.diagonal() += prior.cwiseInverse();
      covariance_ = all.ldlt().solve(Matrix::Identity());
      lens_ = covariance_ * sum;
      prior.head<kCoefficients>() =
          (lens_.cwiseAbs2() + covariance_.diagonal()).head<kCoefficients>();
    }
    LensBends bends;
    for (std::size_t i = 0; i < readings.size(); ++i) {
      const LensReading& r = readings[i];
      if (i == 0 || r.p != readings[i - 1].p) bends = At(r.p);
      in_sigmas[i] = std::abs(r.value - r.along.dot(bends)) / std::sqrt(r.variance);
    }
    constexpr double kSigmaPerMedian = 1.4826;
    scale = std::max(1.0, kSigmaPerMedian * Median(in_sigmas));
  }
}

Eigen::Vector2d LensCurvature::Change(const BentMarker& bent) const {
  Eigen::Vector2d change(0, 0);
  for (const BentPiece& piece : bent.pieces) change += piece.by_bends * (At(piece.p) - piece.bends);
  return change;
}

double LensCurvature::Sigma(const BentMarker& bent) const {
  Eigen::Matrix<double, 2, kUnknowns> by_lens = Eigen::Matrix<double, 2, kUnknowns>::Zero();
  for (const BentPiece& piece : bent.pieces) by_lens += piece.by_bends * BendsByLens(piece.p);
  const Eigen::Matrix2d of_lens = by_lens * covariance_ * by_lens.transpose();
  return std::sqrt(bent.sigma * bent.sigma + of_lens.trace() / 2);
}

double LensCurvature::Variance(const Eigen::Vector2d& p, const LensBends& row) const {
  const Lens by_lens = BendsByLens(p).transpose() * row;
  return by_lens.dot(covariance_ * by_lens);
}

}  // namespace plenocal
