// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/markers/marker_blur.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace plenocal::internal {
namespace TEST_FILE {

// Markers of one type and depth with blurs that differ by `spread` from one to the next.
void Add(
    RawMeasurements* image, int count, int type, double inverse_depth, double blur, double spread) {
  for (int i = 0; i < count; ++i) {
    MarkerMeasurement m;
    m.observation.values = {0, 0, 100.0 + i, 50.0 - 2 * type};
    m.lens_type = type;
    m.inverse_depth = inverse_depth;
    m.blur = blur + spread * (i - (count - 1) / 2.0);
    m.blur_sigma = 0.1;
    image->push_back(m);
  }
}

TEST(MeasureBlur, IsTheMedianOfLikeDepths) {
  RawMeasurements image;
  Add(&image, 31, 0, 0.3, 1, 0.01);
  Add(&image, 31, 0, 0.5, 2, 0.02);
  const std::vector<RawMeasurements> images{image};
  const std::vector<BlurMeasurement> found = MeasureBlur(images);
  ASSERT_EQ(found.size(), 2U);
  for (size_t k = 0; k < 2; ++k) {
    EXPECT_DOUBLE_EQ(found[k].inverse_depth, k == 0 ? 0.3 : 0.5);
    EXPECT_NEAR(found[k].blur, k == 0 ? 1 : 2, 1e-12);
    // The median absolute deviation is that of the eighth neighbour.
    const double deviation = (k == 0 ? 0.01 : 0.02) * 8;
    EXPECT_NEAR(found[k].sigma, std::sqrt(M_PI / 2) * 1.4826 * deviation / std::sqrt(31), 1e-4);
    EXPECT_LT((found[k].place - Eigen::Vector2d(115, 50)).norm(), 1e-9);
    EXPECT_EQ(found[k].lens_type, 0);
  }
}

TEST(MeasureBlur, IsThatOfImagesAndTypesEachByItself) {
  std::vector<RawMeasurements> images(2);
  Add(&images[0], 25, 1, 0.3, 1, 0.01);
  Add(&images[0], 24, 2, 0.3, 5, 0.01);  // too few
  Add(&images[1], 30, 2, 0.3, 3, 0.01);
  Add(&images[1], 30, 3, 0.3, 4, 0);  // without scatter there is no standard error
  const std::vector<BlurMeasurement> found = MeasureBlur(images);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].lens_type, 1);
  EXPECT_EQ(found[1].lens_type, 2);
  EXPECT_NEAR(found[1].blur, 3, 0.01);
}

TEST(MeasureBlur, GroupsByPlaceWhereTheDepthIsOne) {
  std::vector<RawMeasurements> images(1);
  Add(&images[0], 60, 0, 0.3, 1, 0.01);  // from left to right
  const std::vector<BlurMeasurement> found = MeasureBlur(images);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_NEAR(found[0].place.x(), 114.5, 1e-9);
  EXPECT_NEAR(found[1].place.x(), 144.5, 1e-9);
  EXPECT_NEAR(found[1].blur - found[0].blur, 0.3, 0.011);
}

TEST(MeasureBlur, LeavesOutMarkersWithoutOne) {
  std::vector<RawMeasurements> images(1);
  Add(&images[0], 30, 0, 0.3, 1, 0.01);
  for (MarkerMeasurement& m : images[0]) m.blur_sigma = 0;
  EXPECT_TRUE(MeasureBlur(images).empty());
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
