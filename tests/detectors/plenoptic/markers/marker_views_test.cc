// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/marker_views.h"

#include <gtest/gtest.h>

namespace plenocal {
namespace TEST_FILE {

using internal::MarkerMeasurement;
using internal::RawMeasurements;

// Of three lenses in a row; `place` -1 to 1.
MarkerMeasurement Seen(int marker, double inverse_depth, int lens_type, int place) {
  MarkerMeasurement m{.observation = {.marker = marker,
                                      .values = {10, 20, 11.0 + 50 * place, 19},
                                      .detector_sigma = 0.1},
                      .inverse_depth = inverse_depth,
                      .lens_type = lens_type};
  m.vignetting_sensitivity << 0.3, 0.1, -0.2, 0.5;
  m.depth_sensitivity = {0.7, -0.6};
  m.gradient_sensitivity << 300, 100, -200, 400;
  return m;
}

TEST(MarkerViews, StateWhatTheAdjustmentHasToEstimate) {
  const std::vector<View> views =
      MarkerViews({"a", "b", "c"},
                  2,
                  {{Seen(1, 0.5, 0, 0), Seen(1, 0.25, 1, -1)}, {}, {Seen(2, 0.25, 0, 1)}},
                  true);
  ASSERT_EQ(views.size(), 2U);
  EXPECT_EQ(views[1].frame, "c");
  const Observation& seen = views[0].observations[0];
  EXPECT_EQ(seen.values[4], 2);
  EXPECT_EQ(seen.values[5], 0.7);
  EXPECT_EQ(seen.values[6], -0.6);
  EXPECT_EQ(views[0].observations[1].lens_type, 1);
  // The displacement by the pixel's area and the mean of point spreads is known before.
  constexpr double kMean = 1 / 12.0 + 0.18;
  EXPECT_NEAR(seen.values[0], 10 - 0.3 * kMean, 1e-12);
  EXPECT_NEAR(seen.values[1], 20 + 0.2 * kMean, 1e-12);
  // Per coordinate: k_pixel, of each type far and near k and its change to the right and down, then
  // the gradient of ln v, 3e-4 (1 - 1/v).
  const double of_pixel = 0.36 / std::sqrt(12.0);
  const std::vector<double> near{0.3 * of_pixel,  0, 0.1, 0, 0, 0, 0, 0, 0, 0.045, 0.015,  //
                                 -0.2 * of_pixel, 0, 0.5, 0, 0, 0, 0, 0, 0, -0.03, 0.06};
  const std::vector<double> far{0.3 * of_pixel,  0, 0, 0, 0, 0.1, 0, -0.1, 0, 0.0675, 0.0225,  //
                                -0.2 * of_pixel, 0, 0, 0, 0, 0.5, 0, -0.5, 0, -0.045, 0.09};
  ASSERT_EQ(views[0].by_nuisance[0].size(), near.size());
  for (size_t k = 0; k < near.size(); ++k) {
    EXPECT_NEAR(views[0].by_nuisance[0][k], near[k], 1e-12) << k;
    EXPECT_NEAR(views[0].by_nuisance[1][k], far[k], 1e-12) << k;
  }
}

TEST(MarkerViews, OfAParallelArrayHaveNoChangeAcrossIt) {
  const std::vector<View> views =
      MarkerViews({"a"}, 2, {{Seen(1, 0.5, 0, 0), Seen(1, 0.25, 1, -1)}}, false);
  const double of_pixel = 0.36 / std::sqrt(12.0);
  const std::vector<double> near{0.3 * of_pixel, 0, 0.1, 0, 0, -0.2 * of_pixel, 0, 0.5, 0, 0};
  const std::vector<double> far{0.3 * of_pixel, 0, 0, 0.1, 0, -0.2 * of_pixel, 0, 0, 0.5, 0};
  ASSERT_EQ(views[0].by_nuisance[0].size(), near.size());
  for (size_t k = 0; k < near.size(); ++k) {
    EXPECT_NEAR(views[0].by_nuisance[0][k], near[k], 1e-12) << k;
    EXPECT_NEAR(views[0].by_nuisance[1][k], far[k], 1e-12) << k;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
