// SPDX-License-Identifier: Apache-2.0
//
// Bar charts and maps of vectors, by the pixels of their PNG files.
#include <gmock/gmock.h>

#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "apps/charts/bar_chart.h"
#include "apps/charts/field_map.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

cv::Mat Decoded(const std::string& png) {
  return cv::imdecode(
      cv::Mat(1, static_cast<int>(png.size()), CV_8U, const_cast<char*>(png.data())),
      cv::IMREAD_COLOR);
}

// Where a picture has the hue of a colour (red, green, blue), however light.
cv::Mat MaskOf(const cv::Mat& picture, const cv::Vec3d& colour) {
  cv::Mat hues, wanted, mask;
  cv::cvtColor(picture, hues, cv::COLOR_BGR2HSV);
  const cv::Mat pixel(1, 1, CV_8UC3, cv::Scalar(255 * colour[2], 255 * colour[1], 255 * colour[0]));
  cv::cvtColor(pixel, wanted, cv::COLOR_BGR2HSV);
  const double hue = wanted.at<cv::Vec3b>(0)[0];
  cv::inRange(hues, cv::Scalar(hue - 4, 20, 0), cv::Scalar(hue + 4, 255, 255), mask);
  return mask;
}

cv::Vec3d ColourAt(const cv::Mat& picture, double x, double y) {
  const auto bgr = picture.at<cv::Vec3b>(static_cast<int>(y), static_cast<int>(x));
  return {bgr[2] / 255.0, bgr[1] / 255.0, bgr[0] / 255.0};
}

void ExpectColour(const cv::Mat& picture, double x, double y, const cv::Vec3d& colour) {
  const cv::Vec3d at = ColourAt(picture, x, y);
  EXPECT_LT(cv::norm(at - colour), 0.025) << at << " at " << x << ", " << y;
}

// Of the scale from 0 to the largest length, at its ends and in its middle.
const cv::Vec3d kNone(68 / 255.0, 1 / 255.0, 84 / 255.0),
    kHalf(33 / 255.0, 145 / 255.0, 140 / 255.0), kLargest(253 / 255.0, 231 / 255.0, 37 / 255.0),
    kWhite(1, 1, 1);

// Sizes of the picture, px.
constexpr double kMargin = 24, kTitle = 34, kWidth = 900, kScaleWidth = 120;

FieldMap Map(std::array<int, 2> image_size) {
  FieldMap map{"title", image_size, 3, 2, {}};
  map.Put(0, 0, {0, 0});
  map.Put(image_size[0] - 1, 0, {0, -2});
  map.Put(0, image_size[1] - 1, {4, 0});
  return map;
}

TEST(FieldMaps, AreColouredByLengthWithArrowsAlongTheVectors) {
  const cv::Mat picture = Decoded(DrawFieldMaps({Map({600, 400}), Map({300, 300})}, 4));
  // Heights of the maps follow from the images' sizes.
  EXPECT_EQ(picture.cols, 3 * kMargin + kWidth + kScaleWidth);
  EXPECT_EQ(picture.rows, 3 * kMargin + 2 * kTitle + 600 + 900);
  for (const bool second : {false, true}) {
    const double top = second ? 2 * (kMargin + kTitle) + 600 : kMargin + kTitle,
                 height = second ? 900 : 600;
    const double w = kWidth / 3, h = height / 2;  // of a cell
    const auto at = [&](double column, double row, const cv::Vec3d& colour) {
      ExpectColour(picture, kMargin + column * w, top + row * h, colour);
    };
    // Beside the arrows.
    at(0.2, 0.2, kNone);
    at(2.2, 0.2, kHalf);
    at(0.2, 1.2, kLargest);
    for (const double column : {1.2, 2.2}) at(column, 1.2, kWhite);
    at(1.2, 0.2, kWhite);
    // The longest arrow spans two cells: white on its cell; half of it points up.
    const auto is_arrow = [&](double column, double row, const cv::Vec3d& ground) {
      const cv::Vec3d colour = ColourAt(picture, kMargin + column * w, top + row * h);
      return cv::norm(kWhite - colour) < 0.7 * cv::norm(kWhite - ground);  // a thin line
    };
    EXPECT_TRUE(is_arrow(0.7, 1.5, kLargest));
    EXPECT_FALSE(is_arrow(0.3, 1.5, kLargest));
    EXPECT_TRUE(is_arrow(2.5, 0.2, kHalf));
    EXPECT_FALSE(is_arrow(2.5, 0.8, kHalf));
    // The scale.
    const double x = 2 * kMargin + kWidth + 10;
    ExpectColour(picture, x, top + 2, kLargest);
    ExpectColour(picture, x, top + height / 2, kHalf);
    ExpectColour(picture, x, top + height - 4, kNone);
    ExpectColour(picture, x - 14, top + height / 2, kWhite);
  }
}

TEST(FieldMaps, OfRoundingErrorsHaveNoColour) {
  const cv::Mat picture = Decoded(DrawFieldMaps({[] {
                                                  FieldMap map{"title", {600, 400}, 1, 1, {}};
                                                  map.Put(0, 0, {1e-9, 0});
                                                  return map;
                                                }()},
                                                1e-9));
  ExpectColour(picture, kMargin + 100, kMargin + kTitle + 100, kNone);
}

TEST(FieldMaps, OfAnImageThatIsNearlyALineAreNotLongerThanFourWidths) {
  const cv::Mat picture = Decoded(DrawFieldMaps({Map({1, 100000})}, 4));
  EXPECT_EQ(picture.rows, 2 * kMargin + kTitle + 4 * kWidth);
}

const std::vector<cv::Vec3d> kBars{
    {0.12, 0.38, 0.66}, {0.85, 0.45, 0.13}, {0.25, 0.58, 0.30}, {0.58, 0.33, 0.62}};
// Points; two pixels each.
constexpr double kPlotTop = 16 + 40, kPlotHeight = 240, kBar = 30;

// Box of a colour, in points.
cv::Rect2d BoxOf(const cv::Mat& picture, const cv::Vec3d& colour) {
  const cv::Rect box = cv::boundingRect(MaskOf(picture, colour));
  return {box.x / 2.0, box.y / 2.0, box.width / 2.0, box.height / 2.0};
}

TEST(BarCharts, HaveBarsFromTheBaseOnOneScale) {
  const double failed = std::numeric_limits<double>::infinity();
  const BarChart chart{.runs = {"a", "b", "c", "d"},
                       .panels = {{"first", 1, {2, std::nullopt, failed, 3}}}};
  const cv::Mat picture = Decoded(DrawBarChart(chart, PictureFormat::kPng));
  EXPECT_EQ(picture.rows, 2 * (16 + 40 + 240 + 24 + 16));
  // Steps of 0.5; the axis ends at 3.5, the first that leaves 5 % above the highest bar.
  const cv::Rect2d a = BoxOf(picture, kBars[0]), d = BoxOf(picture, kBars[3]);
  for (const auto& [box, value] : {std::pair(a, 2), {d, 3}}) {
    EXPECT_NEAR(box.width, kBar, 1);
    EXPECT_NEAR(box.height, (value - 1) / 2.5 * kPlotHeight, 2);
    EXPECT_NEAR(box.br().y, kPlotTop + kPlotHeight, 1);
  }
  EXPECT_EQ(cv::countNonZero(MaskOf(picture, kBars[1])), 0);
  // Hatched over the whole height: most of it is white.
  const cv::Rect2d c = BoxOf(picture, kBars[2]);
  EXPECT_NEAR(c.width, kBar, 2);
  EXPECT_NEAR(c.height, kPlotHeight, 2);
  EXPECT_NEAR(c.x + c.width / 2 - a.x - a.width / 2, (d.x - a.x) * 2 / 3, 1);
  const double share = cv::countNonZero(MaskOf(picture, kBars[2])) / (4 * c.area());
  EXPECT_GT(share, 0.02);
  EXPECT_LT(share, 0.4);
}

TEST(BarCharts, DoNotMagnifyRoundingErrors) {
  const BarChart chart{.runs = {"a"}, .panels = {{"first", 1, {1 + 1e-9}}}};
  EXPECT_LT(BoxOf(Decoded(DrawBarChart(chart, PictureFormat::kPng)), kBars[0]).height, 2);
}

TEST(BarCharts, HavePanelsBesideEachOther) {
  const auto width = [](const BarChart& chart) {
    return Decoded(DrawBarChart(chart, PictureFormat::kPng)).cols / 2.0;
  };
  const BarPanel panel{"p", 0, {1, 2}};
  const double one = width({{"a", "b"}, {panel}}), two = width({{"a", "b"}, {panel, panel}});
  EXPECT_NEAR(two - one, one - 16, 1);
  EXPECT_GT(width({{"a", "a long name of a run"}, {panel}}), one + 50);
  BarPanel titled = panel;
  titled.title = std::string(60, 'W');
  EXPECT_GT(width({{"a", "b"}, {titled}}), one + 100);
  EXPECT_THAT(DrawBarChart({{"a", "b"}, {panel}}, PictureFormat::kSvg), HasSubstr("<svg"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
