// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/views/depth_picture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <tuple>
#include <utility>

namespace plenocal::internal {
namespace TEST_FILE {

// Inverse depths from 0.2 to 0.4 along the columns, all known.
VirtualDepth Ramp(int columns, int rows) {
  VirtualDepth depth;
  depth.inverse = cv::Mat(rows, columns, CV_32F);
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      depth.inverse.at<float>(y, x) =
          0.2F + 0.2F * static_cast<float>(x) / static_cast<float>(columns - 1);
    }
  }
  depth.known = cv::Mat(rows, columns, CV_8U, cv::Scalar(255));
  return depth;
}

TEST(UsualRange, LeavesOutAHundredthAtEitherEnd) {
  VirtualDepth depth = Ramp(201, 1);
  auto [low, high] = UsualRange(depth);
  EXPECT_NEAR(low, 0.202, 1e-5);
  EXPECT_NEAR(high, 0.398, 1e-5);
  depth.inverse.at<float>(0, 100) = 9;
  depth.inverse.at<float>(0, 101) = -9;
  std::tie(low, high) = UsualRange(depth);
  EXPECT_NEAR(low, 0.201, 1e-5);
  EXPECT_NEAR(high, 0.399, 1e-5);
  depth.known.colRange(0, 101).setTo(0);
  std::tie(low, high) = UsualRange(depth);
  EXPECT_NEAR(low, 0.302, 1e-5) << "of what is known";
  depth.known.setTo(0);
  EXPECT_EQ(UsualRange(depth), std::pair(0.0F, 1.0F));
}

TEST(RxLiveDepth, IsOneLessTheInverseOfVirtualDepth) {
  VirtualDepth depth;
  depth.inverse = (cv::Mat_<float>(1, 6) << 0.25F, 0.5F, 1.0F, 0.0F, -0.125F, 0.25F);
  depth.known = (cv::Mat_<uchar>(1, 6) << 255, 255, 255, 255, 255, 0);
  const cv::Mat values = RxLiveDepth(depth);
  ASSERT_EQ(values.type(), CV_16U);
  const auto at = [&](int x) { return values.at<ushort>(0, x); };
  EXPECT_NEAR(at(0), 0.75 * 65535, 0.5);
  EXPECT_NEAR(at(1), 0.5 * 65535, 0.5);
  EXPECT_EQ(at(2), 0);
  EXPECT_EQ(at(3), 65535);
  EXPECT_EQ(at(4), 0) << "of a Keplerian camera, negative";
  EXPECT_EQ(at(5), 0) << "not known";
}

// The colour of a level of TURBO.
cv::Vec3b Colour(int level) {
  cv::Mat colour;
  cv::applyColorMap(cv::Mat(1, 1, CV_8U, cv::Scalar(level)), colour, cv::COLORMAP_TURBO);
  return colour.at<cv::Vec3b>(0, 0);
}

TEST(DepthPicture, HasColoursLinearInInverseDepthAndABar) {
  VirtualDepth depth = Ramp(201, 120);
  depth.known(cv::Rect(50, 60, 10, 10)).setTo(0);
  const cv::Mat picture = DepthPicture(depth);
  ASSERT_EQ(picture.type(), CV_8UC3);
  ASSERT_EQ(picture.size(), cv::Size(201 + 110, 120));
  const auto at = [&](int x, int y) { return picture.at<cv::Vec3b>(y, x); };
  // The usual range is 0.202 to 0.398.
  for (const int x : {10, 100, 180}) {
    const int level = static_cast<int>(std::lround(255 * (x - 2) / 196.0));
    EXPECT_LE(cv::norm(at(x, 30), Colour(level), cv::NORM_INF), 4) << x;
  }
  EXPECT_EQ(at(0, 30), Colour(0)) << "below the range";
  EXPECT_EQ(at(200, 30), Colour(255)) << "above the range";
  EXPECT_EQ(at(55, 65), cv::Vec3b(0, 0, 0)) << "unknown";
  // The bar: from the highest inverse depth down.
  EXPECT_EQ(at(220, 10), Colour(255));
  EXPECT_EQ(at(220, 60), Colour(255 - 255 * 50 / 100));
  EXPECT_EQ(at(220, 109), Colour(255 - 255 * 99 / 100));
  EXPECT_EQ(at(220, 110), cv::Vec3b(0, 0, 0));
  EXPECT_EQ(at(210, 60), cv::Vec3b(0, 0, 0)) << "a gap before it";
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
