// SPDX-License-Identifier: Apache-2.0
#include "apps/report/attenuation_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

namespace plenocal {
namespace TEST_FILE {

using Json = nlohmann::json;

constexpr double kRounded = 6e-4;  // of values below 1 with three digits

float ValueAt(int x, int y) { return static_cast<float>((7 * x + 13 * y) % 101) / 101; }

Json MapOf(int columns, int rows, double pitch) {
  cv::Mat image(rows, columns, CV_32F);
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) image.at<float>(y, x) = ValueAt(x, y);
  }
  std::vector<uchar> tiff;
  cv::imencode(".tiff", image, tiff);
  return VignettingJson({tiff.begin(), tiff.end()}, "vignetting_left.tiff", pitch);
}

TEST(VignettingJson, HasTheHighestValueOfEachBlock) {
  const Json map = MapOf(450, 300, 0);
  const int columns = map["columns"], rows = map["rows"];
  EXPECT_EQ(columns, 97);
  EXPECT_EQ(rows, 65);
  ASSERT_EQ(map["values"].size(), 97U * 65U);
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      float highest = 0;
      for (int y = row * 300 / rows; y < (row + 1) * 300 / rows; ++y) {
        for (int x = column * 450 / columns; x < (column + 1) * 450 / columns; ++x) {
          highest = std::max(highest, ValueAt(x, y));
        }
      }
      EXPECT_NEAR(map["values"][row * columns + column], highest, kRounded) << column << ' ' << row;
    }
  }
  EXPECT_FALSE(map.contains("detail")) << "no micro images";
}

TEST(VignettingJson, HasAPixelABlockOfASmallImage) {
  const Json map = MapOf(20, 10, 0);
  EXPECT_EQ(map["columns"], 20);
  EXPECT_EQ(map["rows"], 10);
  EXPECT_NEAR(map["values"][3 * 20 + 7], ValueAt(7, 3), kRounded);
}

TEST(VignettingJson, HasSectionsThroughTheMiddleAsMeansOfNeighbours) {
  const Json map = MapOf(4500, 30, 0);
  EXPECT_EQ(map["row"]["step"], 3);
  ASSERT_EQ(map["row"]["values"].size(), 1500U);
  for (int i = 0; i < 1500; ++i) {
    const double mean = (ValueAt(3 * i, 15) + ValueAt(3 * i + 1, 15) + ValueAt(3 * i + 2, 15)) / 3;
    EXPECT_NEAR(map["row"]["values"][i], mean, kRounded) << i;
  }
  EXPECT_EQ(map["column"]["step"], 1);
  ASSERT_EQ(map["column"]["values"].size(), 30U);
  for (int y = 0; y < 30; ++y) {
    EXPECT_NEAR(map["column"]["values"][y], ValueAt(2250, y), kRounded) << y;
  }
}

// Blocks are a quarter larger than a micro image.
TEST(VignettingJson, ShowsEightMicroImagesInTheMiddle) {
  Json map = MapOf(4500, 300, 100);
  EXPECT_EQ(map["columns"], 37);
  EXPECT_EQ(map["detail"]["first"], 1850);
  ASSERT_EQ(map["detail"]["values"].size(), 800U);
  for (int x = 0; x < 800; ++x) {
    EXPECT_NEAR(map["detail"]["values"][x], ValueAt(1850 + x, 150), kRounded) << x;
  }
  map = MapOf(450, 300, 100);  // fewer
  EXPECT_EQ(map["detail"]["first"], 0);
  EXPECT_EQ(map["detail"]["values"].size(), 450U);
}

}  // namespace TEST_FILE
}  // namespace plenocal
