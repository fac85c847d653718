// SPDX-License-Identifier: Apache-2.0
#include "detectors/images/pictures.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

namespace plenocal {
namespace TEST_FILE {

// The middle of the green crosses of a picture: its first marker's number is drawn in yellow.
cv::Point2d MiddleOfGreen(const cv::Mat& picture) {
  cv::Mat channels[3], green;
  cv::split(picture, channels);
  cv::Mat weight, other;
  cv::max(channels[0], channels[2], other);
  cv::subtract(channels[1], other, weight);
  cv::threshold(weight, green, 60, 0, cv::THRESH_TOZERO);
  // The number stands to the right of the cross and above it: only the arms count.
  const cv::Moments moments = cv::moments(green);
  return {moments.m10 / moments.m00, moments.m01 / moments.m00};
}

Observation Marker(int number, double x, double y) {
  Observation marker{.marker = number};
  marker.values[0] = x;
  marker.values[1] = y;
  return marker;
}

TEST(Reduced, KeepsTheMeanAndOneRowOrColumn) {
  cv::Mat image(40, 60, CV_8U);
  cv::randu(image, 0, 255);
  const cv::Mat half = Reduced(image, 0.5);
  EXPECT_EQ(half.size(), cv::Size(30, 20));
  EXPECT_NEAR(cv::mean(half)[0], cv::mean(image)[0], 0.5);
  EXPECT_NEAR(half.at<unsigned char>(3, 5), cv::mean(image(cv::Rect(10, 6, 2, 2)))[0], 1);
  EXPECT_EQ(Reduced(cv::Mat(1, 60, CV_8U, cv::Scalar(9)), 0.5).size(), cv::Size(30, 1));
  EXPECT_EQ(Reduced(image, 1).data, image.data);
}

// An image of 300 x 200 px is enlarged three times: (100, 50) lies at (301, 151).
TEST(MarkerPicture, HasACrossAtEachMarker) {
  const cv::Mat gray(200, 300, CV_8U, cv::Scalar(40));
  const cv::Mat picture = internal::MarkerPicture(gray, {Marker(1, 100, 50)});
  EXPECT_EQ(picture.size(), cv::Size(900, 600));
  const cv::Point2d at = MiddleOfGreen(picture);
  EXPECT_NEAR(at.x, 301, 0.2);
  EXPECT_NEAR(at.y, 151, 0.2);
}

TEST(MarkerPicture, IsEnlargedFourTimesAtMostAndNotReduced) {
  for (const auto& [width, factor] : {std::pair(50, 4), {250, 4}, {499, 2}, {501, 1}, {1500, 1}}) {
    const cv::Mat gray(40, width, CV_8U, cv::Scalar(40));
    EXPECT_EQ(internal::MarkerPicture(gray, {}).size(), cv::Size(factor * width, factor * 40));
  }
}

// A number over another is left out, its cross is not.
TEST(MarkerPicture, HasNoNumberOverAnother) {
  const cv::Mat gray(1000, 1000, CV_8U, cv::Scalar(40));
  const auto yellow = [&](const std::vector<Observation>& markers) {
    cv::Mat mask;
    cv::inRange(internal::MarkerPicture(gray, markers),
                cv::Scalar(0, 150, 200),
                cv::Scalar(80, 255, 255),
                mask);
    return cv::countNonZero(mask);
  };
  const int one = yellow({Marker(8, 500, 500)});
  EXPECT_GT(one, 0);
  EXPECT_EQ(yellow({Marker(8, 500, 500), Marker(8, 498, 502)}), one);
  EXPECT_EQ(yellow({Marker(8, 500, 500), Marker(8, 600, 500)}), 2 * one);
}

// 4000 px become 1000: the centre of pixel (1999.5, 999.5) lies at (499.5, 249.5).
TEST(SamplePicture, HasItsMarkersWhereTheReducedImageHasThem) {
  const cv::Mat gray(2000, 4000, CV_8U, cv::Scalar(40));
  EXPECT_EQ(internal::SampleScale(gray), 0.25);
  EXPECT_EQ(internal::SampleScale(gray(cv::Rect(0, 0, 100, 200))), 1);
  const std::string jpeg = internal::SamplePicture(gray, {Marker(1, 1999.5, 999.5)});
  const cv::Mat picture =
      cv::imdecode(std::vector<uchar>(jpeg.begin(), jpeg.end()), cv::IMREAD_COLOR);
  ASSERT_EQ(picture.size(), cv::Size(1000, 500));
  const cv::Point2d at = MiddleOfGreen(picture);
  EXPECT_NEAR(at.x, 499.5, 0.25);
  EXPECT_NEAR(at.y, 249.5, 0.25);
}

}  // namespace TEST_FILE
}  // namespace plenocal
