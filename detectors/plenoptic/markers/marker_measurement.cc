// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/marker_measurement.h"

#include <algorithm>

namespace plenocal::internal {

DepthInterpolation::DepthInterpolation(std::span<const RawMeasurements> images) {
  for (const RawMeasurements& image : images) {
    for (const MarkerMeasurement& m : image) {
      low_ = std::min(low_, m.inverse_depth);
      high_ = std::max(high_, m.inverse_depth);
    }
  }
}

Eigen::Vector2d DepthInterpolation::Weights(double inverse_depth) const {
  const double t = high_ > low_ ? (inverse_depth - low_) / (high_ - low_) : 0;
  return {1 - t, t};
}

}  // namespace plenocal::internal
