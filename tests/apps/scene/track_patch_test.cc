// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/track/track_patch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace plenocal {
namespace TEST_FILE {

// A smooth texture: the pixel d about the middle of the key image is at
// middle + shift + A d / (1 + perspective . d).
cv::Mat Texture(const cv::Matx22f& A,
                const cv::Point2f& shift,
                double gain,
                double offset,
                const cv::Vec2f& perspective = {0, 0}) {
  cv::Mat image(80, 80, CV_8U);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const cv::Vec2f d(static_cast<float>(x) - 40 - shift.x, static_cast<float>(y) - 40 - shift.y);
      const cv::Vec2f p = (A - d * perspective.t()).inv() * d;
      const double value = std::sin(0.5 * p[0] + 0.2 * p[1]) + std::cos(0.3 * p[0] - 0.45 * p[1]) +
                           0.5 * std::sin(0.11 * p[0] * p[1] / 4);
      image.at<unsigned char>(y, x) = cv::saturate_cast<unsigned char>(offset + gain * value);
    }
  }
  return image;
}

const cv::Point2f kMiddle(40, 40);

TEST(PatchFit, FindsTheShiftOfATurnedAndStretchedPatch) {
  const cv::Mat key = Texture(cv::Matx22f::eye(), {0, 0}, 40, 128);
  const cv::Matx22f A(1.05F, -0.12F, 0.09F, 0.97F);
  const cv::Point2f shift(0.63F, -0.41F);
  const cv::Mat image = Texture(A, shift, 30, 110);
  const auto place = FitPatch(key, kMiddle, image, {.point = kMiddle});
  ASSERT_TRUE(place);
  constexpr double kInterpolation = 0.02;  // px: bilinear, 8 bits
  EXPECT_NEAR(place->point.x, 40 + shift.x, kInterpolation);
  EXPECT_NEAR(place->point.y, 40 + shift.y, kInterpolation);
  EXPECT_LT(cv::norm(place->A - A), 0.01);
  EXPECT_GT(place->sigma, 0);
  EXPECT_LT(place->sigma, kInterpolation);
}

TEST(PatchFit, TakesThePerspectiveOfASlantedPatchForNoShift) {
  const cv::Mat key = Texture(cv::Matx22f::eye(), {0, 0}, 40, 128);
  const cv::Vec2f perspective(0.006F, -0.004F);
  const cv::Point2f shift(0.3F, 0.2F);
  const cv::Mat image = Texture(cv::Matx22f::eye(), shift, 40, 128, perspective);
  const auto place = FitPatch(key, kMiddle, image, {.point = kMiddle});
  ASSERT_TRUE(place);
  constexpr double kInterpolation = 0.02;  // px: bilinear, 8 bits
  EXPECT_NEAR(place->point.x, 40 + shift.x, kInterpolation);
  EXPECT_NEAR(place->point.y, 40 + shift.y, kInterpolation);
  EXPECT_LT(cv::norm(place->perspective - perspective), 5e-4);
}

TEST(PatchFit, RefusesAnotherPatchAndTheBorder) {
  const cv::Mat key = Texture(cv::Matx22f::eye(), {0, 0}, 40, 128);
  const cv::Mat other = Texture(cv::Matx22f(0, 1, -1, 0), {9, 13}, 40, 128);
  EXPECT_FALSE(FitPatch(key, kMiddle, other, {.point = kMiddle}));
  EXPECT_FALSE(FitPatch(key, {8, 40}, key, {.point = cv::Point2f(8, 40)}));
  EXPECT_FALSE(FitPatch(key, kMiddle, key, {.point = cv::Point2f(75, 40)}));
  const cv::Mat even(80, 80, CV_8U, cv::Scalar(90));
  EXPECT_FALSE(FitPatch(key, kMiddle, even, {.point = kMiddle}));
}

TEST(PatchFit, DoesNotFollowAPointOutOfReach) {
  const cv::Mat key = Texture(cv::Matx22f::eye(), {0, 0}, 40, 128);
  const cv::Mat image = Texture(cv::Matx22f::eye(), {3.5F, 0}, 40, 128);
  EXPECT_FALSE(FitPatch(key, kMiddle, image, {.point = kMiddle}));
}

}  // namespace TEST_FILE
}  // namespace plenocal
