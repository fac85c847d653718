// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/fill_holes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

namespace plenocal::internal {
namespace TEST_FILE {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

TEST(FillHoles, KeepsWhatIsKnown) {
  cv::Mat value(5, 7, CV_32F), variance(5, 7, CV_32F);
  cv::randu(value, 1, 2);
  cv::randu(variance, 0.1, 0.2);
  const cv::Mat whole = value.clone();
  value.at<float>(2, 3) = kNan;
  const Filled filled = FillHoles(value, variance);
  for (int y = 0; y < value.rows; ++y) {
    for (int x = 0; x < value.cols; ++x) {
      if (std::isnan(value.at<float>(y, x))) continue;
      EXPECT_EQ(filled.value.at<float>(y, x), whole.at<float>(y, x));
      EXPECT_EQ(filled.variance.at<float>(y, x), variance.at<float>(y, x));
      EXPECT_EQ(filled.reach.at<float>(y, x), 0);
    }
  }
  EXPECT_GT(filled.value.at<float>(2, 3), 1);
  EXPECT_LT(filled.value.at<float>(2, 3), 2);
  EXPECT_GT(filled.reach.at<float>(2, 3), 0);
}

TEST(FillHoles, SpreadsASingleValueOverTheWholeImage) {
  for (const cv::Size size : {cv::Size(1, 1), {8, 8}, {13, 3}, {1, 17}}) {
    cv::Mat value(size, CV_32F, cv::Scalar(kNan)), variance = value.clone();
    value.at<float>(0, 0) = 3;
    variance.at<float>(0, 0) = 0.25;
    const Filled filled = FillHoles(value, variance);
    EXPECT_EQ(cv::norm(filled.value, cv::Mat(size, CV_32F, cv::Scalar(3)), cv::NORM_INF), 0);
    EXPECT_EQ(cv::norm(filled.variance, cv::Mat(size, CV_32F, cv::Scalar(0.25)), cv::NORM_INF), 0);
  }
}

TEST(FillHoles, IsLessCertainBetweenValuesThatDiffer) {
  cv::Mat value(16, 16, CV_32F, cv::Scalar(kNan));
  value.colRange(0, 4).setTo(1);
  value.colRange(12, 16).setTo(5);
  const Filled filled = FillHoles(value, cv::Mat(value.size(), CV_32F, cv::Scalar(0.01)));
  EXPECT_NEAR(filled.value.at<float>(8, 7) + filled.value.at<float>(8, 8), 6, 1e-4);
  for (int x = 5; x < 12; ++x) {
    EXPECT_GE(filled.value.at<float>(8, x), filled.value.at<float>(8, x - 1));
    EXPECT_GE(filled.reach.at<float>(8, x), 2);
  }
  // Their own spread, (5 - 1)^2 / 4, at most.
  EXPECT_GT(filled.variance.at<float>(8, 8), 0.5);
  EXPECT_LT(filled.variance.at<float>(8, 8), 4.02);
}

TEST(FillHoles, LeavesAnImageWithoutAnything) {
  const cv::Mat value(4, 6, CV_32F, cv::Scalar(kNan));
  const Filled filled = FillHoles(value, value);
  ASSERT_EQ(filled.value.size(), value.size());
  EXPECT_TRUE(std::isnan(filled.value.at<float>(3, 2)));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
