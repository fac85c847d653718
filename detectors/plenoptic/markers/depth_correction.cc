// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/depth_correction.h"

#include <Eigen/Dense>
#include <cmath>

namespace plenocal::internal {
namespace {

/// ln v by the micro images of one marker, less that of its template.
struct LogDepthError {
  Eigen::Vector2d weights;  ///< as of `DepthInterpolation`
  double value, precision;
};

LogDepthError ErrorOf(std::span<const MarkerMeasurement> group, const DepthInterpolation& depths) {
  // Differences from the means, which depend on the marker's position.
  Eigen::Vector2d position(0, 0), slope(0, 0);
  double weights = 0;
  for (const MarkerMeasurement& m : group) {
    const double weight = 1 / (m.observation.detector_sigma * m.observation.detector_sigma);
    position += weight * m.U0();
    slope += weight * m.U0ByInverseDepth();
    weights += weight;
  }
  double information = 0, right = 0;
  for (const MarkerMeasurement& m : group) {
    const double sigma = m.observation.detector_sigma;
    const Eigen::Vector2d by = (m.U0ByInverseDepth() - slope / weights) / sigma;
    information += by.squaredNorm();
    right += by.dot(m.U0() - position / weights) / sigma;
  }
  const double z = group.front().inverse_depth;
  return {depths.Weights(z), -right / (information * z), information * z * z};
}

/// Error of ln v that the markers share, at the nearest and at the farthest marker. Iteratively
/// reweighted least squares with a prior.
Eigen::Vector2d SharedError(const std::vector<LogDepthError>& errors) {
  constexpr int kRounds = 6;  // of reweighting
  // Matching is right to a few hundredths, also where few micro images show a marker.
  constexpr double kPrior = 0.02;
  Eigen::Vector2d shared(0, 0);
  double mean_square = 1;  // of the residuals, in sigmas
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix2d information = Eigen::Matrix2d::Identity() / (kPrior * kPrior);
    Eigen::Vector2d right(0, 0);
    double squares = 0, weights = 0;
    for (const LogDepthError& one : errors) {
      const double residual = std::sqrt(one.precision) * (one.value - one.weights.dot(shared));
      const double robust = round == 0 ? 1 : WideCauchyWeight(residual, mean_square);
      information += robust * one.precision * one.weights * one.weights.transpose();
      right += robust * one.precision * one.value * one.weights;
      squares += robust * residual * residual;
      weights += robust;
    }
    shared = information.ldlt().solve(right);
    if (squares > 0) mean_square = squares / weights;
  }
  return shared;
}

}  // namespace

void CorrectDepthBias(std::vector<RawMeasurements>* images) {
  const DepthInterpolation depths(*images);
  std::vector<LogDepthError> errors;
  for (const auto& group : GroupByMarker(*images)) errors.push_back(ErrorOf(group, depths));
  const Eigen::Vector2d shared = SharedError(errors);
  if (!shared.allFinite()) return;
  for (RawMeasurements& image : *images) {
    for (MarkerMeasurement& m : image) {
      m.Move(depths.Weights(m.inverse_depth).dot(shared) * m.depth_sensitivity);
    }
  }
}

}  // namespace plenocal::internal
