// SPDX-License-Identifier: Apache-2.0
#include "engine/scene/track/track_patch.h"

#include <gtest/gtest.h>

#include <array>
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
                const cv::Vec2f& perspective = {0, 0},
                int side = 80) {
  const auto middle = static_cast<float>(side / 2);
  cv::Mat image(side, side, CV_8U);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const cv::Vec2f d(static_cast<float>(x) - middle - shift.x,
                        static_cast<float>(y) - middle - shift.y);
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

const cv::Matx22f kUpright = cv::Matx22f::eye();
const cv::Mat& Key() {
  static const cv::Mat key = Texture(kUpright, {0, 0}, 40, 128);
  return key;
}

TEST(PatchFit, StartsWithinTwoPixels) {
  for (const cv::Point2f& step : {cv::Point2f(1, 0), {-1, 0}, {0, 1}, {0, -1}, {0.6F, 0.8F}}) {
    EXPECT_TRUE(FitPatch(Key(), kMiddle, Key(), {.point = kMiddle + 1.6F * step})) << step;
    EXPECT_FALSE(FitPatch(Key(), kMiddle, Key(), {.point = kMiddle + 2.1F * step})) << step;
  }
}

TEST(PatchFit, NeedsTwelvePixelsAroundInTheKeyImage) {
  for (const bool upright : {false, true}) {
    const auto fits = [&](float x) {
      const cv::Point2f at = upright ? cv::Point2f(40, x) : cv::Point2f(x, 40);
      return FitPatch(Key(), at, Key(), {.point = at}).has_value();
    };
    EXPECT_TRUE(fits(12));
    EXPECT_FALSE(fits(11.99F));
    EXPECT_TRUE(fits(66.99F));
    EXPECT_FALSE(fits(67));
  }
}

// Whether a patch whose rows are turned and stretched fits at this distance from the four borders.
std::array<bool, 4> FitsBeside(const cv::Matx22f& A, const cv::Vec2f& perspective, float distance) {
  constexpr int kMiddleOfImage = 60;
  const int whole = static_cast<int>(std::round(distance));
  const float rest = distance - static_cast<float>(whole);
  std::array<bool, 4> fits{};
  for (int side = 0; side < 4; ++side) {
    const bool before = side < 2, along_x = side % 2 == 0;
    const float off = before ? rest : -rest;
    const cv::Point2f shift = along_x ? cv::Point2f(off, 0) : cv::Point2f(0, off);
    const cv::Mat all = Texture(A, shift, 40, 128, perspective, 2 * kMiddleOfImage);
    // The last row or column that is used is the last but one.
    const int begin = before ? kMiddleOfImage - whole : 0,
              end = before ? 2 * kMiddleOfImage : kMiddleOfImage + whole + 1;
    const cv::Range used(begin, end), whole_range(0, 2 * kMiddleOfImage);
    const cv::Mat image = all(along_x ? whole_range : used, along_x ? used : whole_range).clone();
    const auto at = static_cast<float>(kMiddleOfImage);
    const auto in_range = static_cast<float>(kMiddleOfImage - begin);
    const cv::Point2f point = shift + cv::Point2f(along_x ? in_range : at, along_x ? at : in_range);
    fits[static_cast<size_t>(side)] =
        FitPatch(Key(), kMiddle, image, {.point = point, .A = A, .perspective = perspective})
            .has_value();
  }
  return fits;
}

TEST(PatchFit, LeavesNoImage) {
  constexpr std::array<bool, 4> kAll{true, true, true, true}, kNone{};
  struct Case {
    cv::Matx22f A;
    cv::Vec2f perspective;
    float reach = 0;  // of ten pixels, and one more
  };
  for (const Case& each : {Case{kUpright, {0, 0}, 11},
                           {{1.3F, 0, 0, 1}, {0, 0}, 14},
                           {{1, 0.3F, 0, 1}, {0, 0}, 14},
                           {{1, 0, -0.3F, 1}, {0, 0}, 14},
                           {{1, 0, 0, 1.3F}, {0, 0}, 14},
                           {{0.9F, -0.2F, 0, 0.9F}, {0, 0}, 12},
                           {kUpright, {0.01F, -0.015F}, 1 + 10 / 0.75F}}) {
    EXPECT_EQ(FitsBeside(each.A, each.perspective, each.reach + 0.1F), kAll) << each.A;
    EXPECT_EQ(FitsBeside(each.A, each.perspective, each.reach - 0.1F), kNone) << each.A;
  }
}

TEST(PatchFit, RefusesUnusualStretch) {
  const auto fits = [](const cv::Matx22f& A, const cv::Vec2f& perspective = {0, 0}) {
    const cv::Mat image = Texture(A, {0, 0}, 40, 128, perspective, 160);
    const cv::Point2f middle(80, 80);
    const auto place =
        FitPatch(Key(), kMiddle, image, {.point = middle, .A = A, .perspective = perspective});
    if (place) {
      EXPECT_LT(cv::norm(place->point - middle), 0.03);
      EXPECT_LT(cv::norm(place->A - A), 0.05);
      EXPECT_LT(cv::norm(place->perspective - perspective), 0.003);
    }
    return place.has_value();
  };
  EXPECT_TRUE(fits({1.36F, 0, 0, 1.36F}));
  EXPECT_FALSE(fits({1.47F, 0, 0, 1.47F}));
  EXPECT_TRUE(fits({0.76F, 0, 0, 0.76F}));
  EXPECT_FALSE(fits({0.66F, 0, 0, 0.66F}));
  EXPECT_TRUE(fits({0, -1, 1, 0}));  // turned by 90 degrees
  EXPECT_TRUE(fits({3.8F, 0, 0, 0.45F}));
  EXPECT_FALSE(fits({4.2F, 0, 0, 0.45F}));
  EXPECT_TRUE(fits(kUpright, {0.03F, -0.015F}));
  EXPECT_TRUE(fits(kUpright, {-0.015F, 0.03F}));
  EXPECT_FALSE(fits(kUpright, {0.03F, -0.025F}));
}

cv::Mat WithNoise(double sigma, unsigned seed, double gain = 1) {
  cv::Mat noise(Key().size(), CV_32F), image;
  cv::RNG(seed).fill(noise, cv::RNG::NORMAL, 0, sigma);
  cv::Mat sum = noise;
  Key().convertTo(image, CV_32F);
  sum = gain * (image + noise);
  sum.convertTo(image, CV_8U);
  return image;
}

TEST(PatchFit, StatesTheStandardErrorOfItsPlace) {
  double square = 0, stated = 0;
  constexpr int kTries = 60;
  for (unsigned seed = 1; seed <= kTries; ++seed) {
    const auto place = FitPatch(Key(), kMiddle, WithNoise(6, seed), {.point = kMiddle});
    ASSERT_TRUE(place);
    square += place->point.dot(place->point) - 2 * place->point.dot(kMiddle) + kMiddle.dot(kMiddle);
    stated += 2 * place->sigma * place->sigma;
  }
  EXPECT_NEAR(std::sqrt(square / stated), 1, 0.15);
  // Contrast does not matter; noise does.
  const auto sigma = [](double noise, double gain) {
    return FitPatch(Key(), kMiddle, WithNoise(noise, 3, gain), {.point = kMiddle})->sigma;
  };
  EXPECT_NEAR(sigma(6, 0.5) / sigma(6, 1), 1, 0.05);
  EXPECT_NEAR(sigma(12, 1) / sigma(6, 1), 2, 0.1);
}

TEST(PatchFit, NeedsACorrelationOfEightTenths) {
  cv::Scalar mean, spread;
  cv::meanStdDev(Key()(cv::Rect(30, 30, 21, 21)), mean, spread);
  const auto fits = [&](double correlation) {
    const double noise = spread[0] * std::sqrt(1 / (correlation * correlation) - 1);
    int count = 0;
    for (unsigned seed = 1; seed <= 10; ++seed) {
      count += FitPatch(Key(), kMiddle, WithNoise(noise, seed, 0.6), {.point = kMiddle}) ? 1 : 0;
    }
    return count;
  };
  EXPECT_GE(fits(0.86), 9);
  // Values between pixels have less noise.
  EXPECT_LE(fits(0.58), 1);
  cv::Mat inverted = 255 - Key();
  EXPECT_FALSE(FitPatch(Key(), kMiddle, inverted, {.point = kMiddle}));
}

}  // namespace TEST_FILE
}  // namespace plenocal
