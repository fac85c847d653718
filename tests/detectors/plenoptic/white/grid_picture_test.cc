// SPDX-License-Identifier: Apache-2.0
//
// The picture of a white image with its grid, by its pixels.
#include "detectors/plenoptic/white/grid_picture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "tests/detectors/plenoptic/plenoptic_scene.h"

namespace plenocal {
namespace TEST_FILE {

constexpr int kHeight = 1200, kInset = 400;  // px of the picture
constexpr double kSide = 140;                // px of the image in an inset, seven pitches

// Where a pixel p of the image lies when an inset shows it from `first` on.
cv::Point InInset(int number, const Eigen::Vector2d& p, double first) {
  const double scale = kInset / kSide;
  const auto place = [&](double x) {
    return static_cast<int>(std::lround(scale * (x + 0.5 - first) - 0.5));
  };
  return {kHeight + place(p.x()), number * kInset + place(p.y())};
}

bool IsColoured(const cv::Mat& picture, const cv::Point& at) {
  const cv::Vec3b bgr = picture.at<cv::Vec3b>(at);
  return std::max({bgr[0], bgr[1], bgr[2]}) - std::min({bgr[0], bgr[1], bgr[2]}) > 60;
}

class GridPictureOfAField : public ::testing::Test {
 protected:
  GridPictureOfAField() : array_(scene_.Array()), white_(scene_.Attenuation(array_) * 0.5) {}

  // Index of the lens nearest to a place of the image.
  [[nodiscard]] size_t Nearest(const Eigen::Vector2d& p) const {
    return static_cast<size_t>(
        std::ranges::min_element(
            array_.lenses, {}, [&](const MicroLens& lens) { return (lens.centre - p).norm(); }) -
        array_.lenses.begin());
  }

  const PlenopticScene scene_{.pitch = 20, .types = 1};
  MicroLensArray array_;
  cv::Mat white_;
};

TEST_F(GridPictureOfAField, HasTheWholeImageAndThreeParts) {
  const cv::Mat picture = GridPicture(white_, array_);
  ASSERT_EQ(picture.type(), CV_8UC3);
  EXPECT_EQ(picture.rows, kHeight);
  EXPECT_EQ(picture.cols, kHeight + kInset);  // of a square image
  // Bright in the middle of a micro image: the brightest pixel is white.
  double highest = 0;
  cv::minMaxLoc(picture.reshape(1), nullptr, &highest);
  EXPECT_EQ(highest, 255);
  // Each part has a white frame.
  for (int number = 0; number < 3; ++number) {
    for (const cv::Point& corner : {cv::Point(0, 0), cv::Point(kInset - 1, kInset - 1)}) {
      EXPECT_EQ(picture.at<cv::Vec3b>(number * kInset + corner.y, kHeight + corner.x),
                cv::Vec3b(255, 255, 255));
    }
  }
}

TEST_F(GridPictureOfAField, HasACircleAroundEachCentre) {
  const cv::Mat picture = GridPicture(white_, array_);
  const double firsts[] = {0, 130, 260};
  for (int number = 0; number < 3; ++number) {
    const double first = firsts[number];
    const Eigen::Vector2d middle = Eigen::Vector2d::Constant(first + 70);
    const Eigen::Vector2d centre = array_.lenses[Nearest(middle)].centre;
    int coloured = 0;
    for (int k = 0; k < 24; ++k) {
      const double angle = 2 * std::numbers::pi * k / 24;
      const Eigen::Vector2d p = centre + 10 * Eigen::Vector2d(std::cos(angle), std::sin(angle));
      coloured += IsColoured(picture, InInset(number, p, first)) ? 1 : 0;
    }
    EXPECT_GT(coloured, 16) << number;
    // With a mark in its middle that is half a radius long.
    for (const double off : {-2.0, 0.0, 2.0}) {
      const cv::Point at = InInset(number, centre + Eigen::Vector2d(off, 0), first);
      EXPECT_TRUE(IsColoured(picture, at)) << number;
    }
    EXPECT_FALSE(IsColoured(picture, InInset(number, centre + Eigen::Vector2d(5, 0), first)));
  }
}

TEST_F(GridPictureOfAField, CrossesOutWhatIsNotUsable) {
  const size_t bad = Nearest({200, 200});
  array_.lenses[bad].usable = false;
  const cv::Mat picture = GridPicture(white_, array_);
  const Eigen::Vector2d centre = array_.lenses[bad].centre;
  for (const Eigen::Vector2d& along : {Eigen::Vector2d(1, 0), {-1, 0}, {0, 1}, {0, -1}}) {
    EXPECT_TRUE(IsColoured(picture, InInset(1, centre + 4 * along, 130)));
    EXPECT_TRUE(IsColoured(picture, InInset(1, centre + 8 * along, 130)));
  }
  // In the whole image, too, three times as large.
  const cv::Point at(static_cast<int>(std::lround(3 * (centre.x() + 0.5) - 0.5)),
                     static_cast<int>(std::lround(3 * (centre.y() + 0.5) - 0.5)));
  EXPECT_TRUE(IsColoured(picture, at + cv::Point(20, 0)));
  EXPECT_TRUE(IsColoured(picture, at - cv::Point(0, 20)));
}

TEST_F(GridPictureOfAField, MarksTheCentresOfLargeMicroImages) {
  // The image of 200 px is enlarged sixfold, so that circles have a radius of 60 px.
  const PlenopticScene large{.width = 200, .height = 200, .pitch = 20, .types = 1};
  const MicroLensArray array = large.Array();
  const cv::Mat picture = GridPicture(large.Attenuation(array), array);
  for (const MicroLens& lens : array.lenses) {
    const auto place = [](double x) { return static_cast<int>(std::lround(6 * (x + 0.5) - 0.5)); };
    const cv::Point at(place(lens.centre.x()), place(lens.centre.y()));
    if (at.x < 80 || at.y < 80 || at.x > 1120 || at.y > 1120) continue;
    // A quarter of the radius long.
    EXPECT_TRUE(IsColoured(picture, at + cv::Point(12, 0)));
    EXPECT_TRUE(IsColoured(picture, at + cv::Point(0, -12)));
    EXPECT_FALSE(IsColoured(picture, at + cv::Point(20, 0)));
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
