// SPDX-License-Identifier: Apache-2.0
#include "detectors/apriltag/least_contrast.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

namespace plenocal::internal {
namespace TEST_FILE {

constexpr int kOfTheLibrary = 5;

cv::Mat Noise(const cv::Size& size, double level, double sigma) {
  cv::Mat values(size, CV_32F), gray;
  cv::RNG(7).fill(values, cv::RNG::NORMAL, level, sigma);
  values.convertTo(gray, CV_8U);
  return gray;
}

TEST(LeastContrast, FollowsTheNoise) {
  for (const double sigma : {1.0, 2.0, 4.0, 12.0}) {
    EXPECT_NEAR(LeastContrast(Noise({320, 256}, 120, sigma)), 6 * sigma, 0.5 + 0.6 * sigma);
  }
}

TEST(LeastContrast, IsTheLibrarysWithoutNoise) {
  EXPECT_EQ(LeastContrast(Noise({320, 256}, 120, 0)), kOfTheLibrary);
  EXPECT_EQ(LeastContrast(Noise({320, 256}, 120, 0.5)), kOfTheLibrary);
  EXPECT_EQ(LeastContrast(Noise({20, 20}, 120, 9)), kOfTheLibrary);  // no block to measure
}

TEST(LeastContrast, DisregardsTextureAndClippedParts) {
  const cv::Size size(640, 512);
  cv::Mat gray = Noise(size, 120, 2);
  const int noise = LeastContrast(gray);
  cv::Mat texture = gray(cv::Rect(0, 0, 500, size.height));
  cv::RNG(8).fill(texture, cv::RNG::UNIFORM, 0, 256);
  EXPECT_NEAR(LeastContrast(gray), noise, 1);
  gray(cv::Rect(0, 0, 500, size.height)) = 255;
  EXPECT_NEAR(LeastContrast(gray), noise, 1);
  gray = 255;
  EXPECT_EQ(LeastContrast(gray), kOfTheLibrary);
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
