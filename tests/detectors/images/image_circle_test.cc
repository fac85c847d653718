// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/image_circle.h"

#include <gtest/gtest.h>

#include <array>
#include <opencv2/imgproc.hpp>

#include "tests/digest.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr ImageSize kSize{640, 480};

cv::Mat Black() { return {kSize[1], kSize[0], CV_8U, cv::Scalar(12)}; }

std::optional<ImageCircle> Found(const std::vector<cv::Mat>& images) {
  internal::ImageCircleFit fit(kSize);
  for (const cv::Mat& image : images) fit.Add(internal::CellLevels(image));
  return fit.Fit();
}

TEST(ImageCircle, IsWhatIsNotBlackInAllImages) {
  std::vector<cv::Mat> images;
  for (const int dark : {100, 250, 420}) {  // an object in each, black in that image
    images.push_back(Black());
    cv::ellipse(images.back(), {330, 236}, {290, 265}, 0, 0, 360, 140, cv::FILLED);
    cv::rectangle(images.back(), {dark, 150, 120, 200}, 12, cv::FILLED);
  }
  const std::optional<ImageCircle> circle = Found(images);
  ASSERT_TRUE(circle);
  EXPECT_NEAR(circle->centre.x(), 330, 5);
  EXPECT_NEAR(circle->centre.y(), 236, 5);
  EXPECT_NEAR(circle->radii.x(), 290, 6);
  EXPECT_NEAR(circle->radii.y(), 265, 6);
  EXPECT_TRUE(circle->Has({60, 236}));
  EXPECT_FALSE(circle->Has({20, 20}));
}

TEST(ImageCircle, OfAnOrdinaryLensIsNotThere) {
  cv::Mat image(kSize[1], kSize[0], CV_8U, cv::Scalar(130));
  EXPECT_FALSE(Found({image}));
  cv::rectangle(image, {0, 0, 100, 90}, 12, cv::FILLED);  // a dark corner of the room
  EXPECT_FALSE(Found({image}));
}

TEST(ImageCircle, IsNotTakenFromABoardBeforeBlack) {
  std::vector<cv::Mat> images;
  for (const int x : {150, 220, 300}) {
    images.push_back(Black());
    cv::rectangle(images.back(), {x, 120, 200, 230}, 220, cv::FILLED);
  }
  EXPECT_FALSE(Found(images));
}

TEST(ImageCircle, OfDimNoisyImagesIsTheSameAsBefore) {
  Digest digest;
  for (const double angle : {0.0, 6.0}) {
    std::vector<cv::Mat> images;
    cv::RNG random(4);
    for (const int x : {160, 250, 330}) {
      cv::Mat noise(kSize[1], kSize[0], CV_8U);
      random.fill(noise, cv::RNG::UNIFORM, 0, 14);
      images.push_back(Black());
      cv::ellipse(images.back(), {311, 243}, {270, 228}, angle, 0, 360, 40, cv::FILLED);
      cv::rectangle(images.back(), {x, 30, 120, 230}, 14, cv::FILLED);
      images.back() += noise;
    }
    const std::optional<ImageCircle> circle = Found(images);
    ASSERT_TRUE(circle);
    digest.AddAll(circle->centre);
    digest.AddAll(circle->radii);
  }
  EXPECT_NEAR(digest.Sum(), -256.2584, 1e-3);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
