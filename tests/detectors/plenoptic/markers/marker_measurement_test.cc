// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/marker_measurement.h"

#include <gtest/gtest.h>

namespace plenocal::internal {
namespace TEST_FILE {

/// A marker seen in one micro image: by its number and inverse depth alone.
MarkerMeasurement Of(int marker, double inverse_depth) {
  return {.observation = {.marker = marker, .detector_sigma = 1}, .inverse_depth = inverse_depth};
}

TEST(MeasuredRange, InterpolatesBetweenTheNearestAndTheFarthestMarker) {
  const std::vector<RawMeasurements> images{{Of(1, 0.3), Of(2, 0.25)}, {Of(1, 0.4)}};
  const MeasuredRange range(images);
  EXPECT_LT((range.DepthWeights(0.25) - Eigen::Vector2d(1, 0)).norm(), 1e-12);
  EXPECT_LT((range.DepthWeights(0.4) - Eigen::Vector2d(0, 1)).norm(), 1e-12);
  EXPECT_LT((range.DepthWeights(0.3) - Eigen::Vector2d(2 / 3.0, 1 / 3.0)).norm(), 1e-12);
}

TEST(MeasuredRange, StatesPlacesFromTheMiddleOfTheLongerSide) {
  std::vector<RawMeasurements> images{{Of(1, 0.3), Of(2, 0.3)}};
  images[0][0].observation.values = {0, 0, 100, 300};
  images[0][1].observation.values = {0, 0, 300, 200};
  const MeasuredRange range(images);
  EXPECT_LT((range.Place({100, 250}) - Eigen::Vector2d(-1, 0)).norm(), 1e-12);
  EXPECT_LT((range.Place({200, 300}) - Eigen::Vector2d(0, 0.5)).norm(), 1e-12);
}

TEST(MeasuredRange, HasOneValueForOneDepthAndOneLens) {
  const std::vector<RawMeasurements> images{{Of(1, 0.3), Of(2, 0.3)}};
  EXPECT_EQ(MeasuredRange(images).DepthWeights(0.3), Eigen::Vector2d(1, 0));
  EXPECT_EQ(MeasuredRange(images).Place({10, 20}), Eigen::Vector2d(0, 0));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
