// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/marker_measurement.h"

#include <algorithm>

namespace plenocal::internal {

MeasuredRange::MeasuredRange(std::span<const RawMeasurements> images) {
  for (const RawMeasurements& image : images) {
    for (const MarkerMeasurement& m : image) {
      low_ = std::min(low_, m.inverse_depth);
      high_ = std::max(high_, m.inverse_depth);
      least_ = least_.cwiseMin(m.Centre());
      most_ = most_.cwiseMax(m.Centre());
    }
  }
}

Eigen::Vector2d MeasuredRange::DepthWeights(double inverse_depth) const {
  const double t = high_ > low_ ? (inverse_depth - low_) / (high_ - low_) : 0;
  return {1 - t, t};
}

Eigen::Vector2d MeasuredRange::Place(const Eigen::Vector2d& centre) const {
  const double half = (most_ - least_).maxCoeff() / 2;
  if (!(half > 0)) return {0, 0};
  return (centre - (least_ + most_) / 2) / half;
}

}  // namespace plenocal::internal
