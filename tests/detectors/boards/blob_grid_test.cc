// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/blob_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace plenocal::internal {
namespace TEST_FILE {

struct Drawing {
  int columns = 7, rows = 5;
  bool asymmetric = false, bright = false;
  std::vector<int> missing = {};  ///< numbers of circles that are not drawn
  double angle = 0.2;
};

// Circles of 8 px on a tilted plane.
cv::Mat Draw(const Drawing& drawing) {
  const cv::Scalar ground = drawing.bright ? 30 : 220, ink = drawing.bright ? 220 : 30;
  cv::Mat image(480, 640, CV_8U, ground);
  constexpr int kShift = 4;
  int number = 0;
  for (int row = 0; row < drawing.rows; ++row) {
    for (int column = 0; column < drawing.columns; ++column) {
      if (std::ranges::count(drawing.missing, number++) > 0) continue;
      // Rows of an asymmetric grid are half a step apart, every second one is half a step aside.
      const double x = drawing.asymmetric ? 2 * column + row % 2 : column, y = row;
      const double step = drawing.asymmetric ? 26 : 40, w = 1 + 0.01 * x - 0.008 * y;
      const double u = 150 + step * (std::cos(drawing.angle) * x - std::sin(drawing.angle) * y) / w,
                   v = 100 + step * (std::sin(drawing.angle) * x + std::cos(drawing.angle) * y) / w;
      const cv::Point at(static_cast<int>(u * (1 << kShift)), static_cast<int>(v * (1 << kShift)));
      cv::circle(image, at, 8 << kShift, ink, cv::FILLED, cv::LINE_AA, kShift);
    }
  }
  return image;
}

TEST(FindBlobs, HaveAtLeastTwelvePixelsAndAreOfOneColour) {
  const cv::Mat dark = Draw({});
  EXPECT_EQ(FindBlobs(dark, false, 1e4F).size(), 35);
  EXPECT_EQ(FindBlobs(dark, true, 1e4F).size(), 0);
  EXPECT_EQ(FindBlobs(Draw({.bright = true}), true, 1e4F).size(), 35);
  EXPECT_EQ(FindBlobs(dark, false, 100).size(), 0);  // they have 200
  EXPECT_EQ(FindBlobs(dark, false, 11).size(), 0);
}

TEST(FindBlobGrid, OfASymmetricGridHasTheLongerSideFirst) {
  for (const bool bright : {false, true}) {
    for (const auto& [columns, rows] : {std::pair(7, 5), {4, 6}, {3, 3}}) {
      const auto grid = FindBlobGrid(Draw({.columns = columns, .rows = rows, .bright = bright}));
      ASSERT_TRUE(grid) << columns << " x " << rows;
      EXPECT_EQ(grid->columns, std::max(columns, rows));
      EXPECT_EQ(grid->rows, std::min(columns, rows));
      EXPECT_FALSE(grid->asymmetric);
    }
  }
}

TEST(FindBlobGrid, OfAnAsymmetricGridHasRowsOfEvenNumber) {
  for (const auto& [columns, rows] : {std::pair(4, 11), {5, 7}, {6, 5}}) {
    const auto grid = FindBlobGrid(Draw({.columns = columns, .rows = rows, .asymmetric = true}));
    ASSERT_TRUE(grid) << columns << " x " << rows;
    EXPECT_TRUE(grid->asymmetric);
    EXPECT_EQ(grid->columns, columns);
    EXPECT_EQ(grid->rows, rows);
  }
}

TEST(FindBlobGrid, ToleratesAFewMissingCircles) {
  const auto grid = FindBlobGrid(Draw({.columns = 8, .rows = 7, .missing = {0, 20, 37}}));
  ASSERT_TRUE(grid);
  EXPECT_EQ(grid->columns, 8);
  EXPECT_EQ(grid->rows, 7);
}

TEST(FindBlobGrid, IsFoundAtEveryAngle) {
  for (int k = -4; k < 4; ++k) {
    const Drawing drawing{.columns = 6, .rows = 4, .angle = 0.12 * k};
    const auto grid = FindBlobGrid(Draw(drawing));
    ASSERT_TRUE(grid) << k;
    EXPECT_EQ(grid->columns, 6) << k;
    EXPECT_EQ(grid->rows, 4) << k;
  }
}

// Circles that are not on the lattice, the last near a corner of the grid.
TEST(FindBlobGrid, LeavesOutCirclesBesideIt) {
  cv::Mat image = Draw({.columns = 6, .rows = 5});
  for (const cv::Point& at : {cv::Point(40, 40), {600, 60}, {560, 420}, {40, 300}, {125, 75}}) {
    cv::circle(image, at, 8, 30, cv::FILLED, cv::LINE_AA);
  }
  const auto grid = FindBlobGrid(image);
  ASSERT_TRUE(grid);
  EXPECT_EQ(grid->columns, 6);
  EXPECT_EQ(grid->rows, 5);
}

TEST(FindBlobGrid, OfTwoIsTheLarger) {
  for (const bool larger_first : {false, true}) {
    cv::Mat image(480, 1280, CV_8U, cv::Scalar(220));
    Draw({.columns = larger_first ? 7 : 5, .rows = 5}).copyTo(image(cv::Rect(0, 0, 640, 480)));
    Draw({.columns = larger_first ? 5 : 7, .rows = 5}).copyTo(image(cv::Rect(640, 0, 640, 480)));
    const auto grid = FindBlobGrid(image);
    ASSERT_TRUE(grid);
    EXPECT_EQ(grid->columns, 7);
    EXPECT_EQ(grid->rows, 5);
  }
}

TEST(FindBlobGrid, IsNoneWithoutThreeByThreeCircles) {
  EXPECT_FALSE(FindBlobGrid(cv::Mat(480, 640, CV_8U, cv::Scalar(128))));
  EXPECT_FALSE(FindBlobGrid(Draw({.columns = 7, .rows = 2})));
  EXPECT_FALSE(FindBlobGrid(Draw({.columns = 1, .rows = 7})));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
