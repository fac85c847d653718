// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/marker_measurement.h"

#include <gtest/gtest.h>

namespace plenocal::internal {
namespace TEST_FILE {

/// A marker seen in one micro image: by its number and inverse depth alone.
MarkerMeasurement Of(int marker, double inverse_depth) {
  return {.observation = {.marker = marker, .detector_sigma = 1}, .inverse_depth = inverse_depth};
}

TEST(DepthInterpolation, IsLinearBetweenTheNearestAndTheFarthestMarker) {
  const std::vector<RawMeasurements> images{{Of(1, 0.3), Of(2, 0.25)}, {Of(1, 0.4)}};
  const DepthInterpolation depths(images);
  EXPECT_LT((depths.Weights(0.25) - Eigen::Vector2d(1, 0)).norm(), 1e-12);
  EXPECT_LT((depths.Weights(0.4) - Eigen::Vector2d(0, 1)).norm(), 1e-12);
  EXPECT_LT((depths.Weights(0.3) - Eigen::Vector2d(2 / 3.0, 1 / 3.0)).norm(), 1e-12);
}

TEST(DepthInterpolation, HasOneValueForOneDepth) {
  const std::vector<RawMeasurements> images{{Of(1, 0.3), Of(2, 0.3)}};
  EXPECT_EQ(DepthInterpolation(images).Weights(0.3), Eigen::Vector2d(1, 0));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
