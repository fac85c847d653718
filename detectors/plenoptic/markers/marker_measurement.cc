// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/marker_measurement.h"

#include <algorithm>

#include "calib/base/robust.h"

namespace plenocal::internal {

std::vector<std::span<const MarkerMeasurement>> GroupByMarker(
    std::span<const RawMeasurements> images) {
  std::vector<std::span<const MarkerMeasurement>> groups;
  for (const RawMeasurements& image : images) {
    for (size_t begin = 0, end = 0; begin < image.size(); begin = end) {
      const int marker = image[begin].observation.marker;
      while (end < image.size() && image[end].observation.marker == marker) ++end;
      if (end - begin > 2) groups.emplace_back(image.data() + begin, end - begin);
    }
  }
  return groups;
}

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

double WideCauchyWeight(double residual, double mean_square) {
  constexpr double kWidth = 3;  // root mean squares
  return CauchyWeight(residual * residual / (kWidth * kWidth * mean_square));
}

}  // namespace plenocal::internal
