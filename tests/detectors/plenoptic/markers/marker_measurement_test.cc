// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/marker_measurement.h"

#include <gtest/gtest.h>

#include <cmath>

namespace plenocal::internal {
namespace {

/// A marker seen in one micro image: by its number and inverse depth alone.
MarkerMeasurement Of(int marker, double inverse_depth) {
  return {.observation = {.marker = marker, .detector_sigma = 1}, .inverse_depth = inverse_depth};
}

TEST(GroupByMarker, TakesMarkersWithMoreThanTwoMicroImages) {
  const std::vector<RawMeasurements> images{
      {Of(1, 0.3), Of(1, 0.3), Of(2, 0.3), Of(2, 0.3), Of(2, 0.3), Of(5, 0.3)},
      {},
      {Of(2, 0.2), Of(2, 0.2), Of(2, 0.2), Of(2, 0.2)}};
  const auto groups = GroupByMarker(images);
  ASSERT_EQ(groups.size(), 2u);
  EXPECT_EQ(groups[0].size(), 3u);
  EXPECT_EQ(groups[0].data(), images[0].data() + 2);
  EXPECT_EQ(groups[1].size(), 4u);
  EXPECT_EQ(groups[1].data(), images[2].data());
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

TEST(MarkerMeasurement, HasOneU0InAllMicroImagesOfAPoint) {
  // Eq. (1) of docs/plenoptic.md for q and v, in several micro images.
  const Eigen::Vector2d q(410, 287);
  constexpr double kDepth = 4.2;
  int checked = 0;
  for (const Eigen::Vector2d& c : {Eigen::Vector2d(400, 280), {418, 280}, {409, 296}}) {
    const Eigen::Vector2d x = c + (q - c) / kDepth;
    const MarkerMeasurement seen{.observation = {.values = {x.x(), x.y(), c.x(), c.y()}},
                                 .inverse_depth = 1 / kDepth};
    EXPECT_LT((seen.U0() - q / kDepth).norm(), 1e-12);
    ++checked;
  }
  EXPECT_EQ(checked, 3);
}

TEST(WideCauchyWeight, FallsToAHalfAtThreeTimesTheRoot) {
  EXPECT_EQ(WideCauchyWeight(0, 4), 1);
  EXPECT_NEAR(WideCauchyWeight(6, 4), 0.5, 1e-12);
  EXPECT_LT(WideCauchyWeight(60, 4), 0.01);
}

}  // namespace
}  // namespace plenocal::internal
