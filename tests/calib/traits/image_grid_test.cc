// SPDX-License-Identifier: Apache-2.0
#include "calib/traits/image_grid.h"

#include <gtest/gtest.h>

namespace plenocal {
namespace TEST_FILE {

TEST(ImageGrid, HasCellsThatAreNearlySquare) {
  const ImageGrid wide({640, 480}, 8), high({480, 640}, 8), strip({1000, 10}, 8);
  EXPECT_EQ(wide.Columns(), 8);
  EXPECT_EQ(wide.Rows(), 6);
  EXPECT_EQ(wide.Cells(), 48U);
  EXPECT_EQ(high.Columns(), 6);
  EXPECT_EQ(high.Rows(), 8);
  EXPECT_EQ(strip.Rows(), 1);
}

// Cells of 80 px: the image begins at -0.5, the second column and row at 79.5.
TEST(ImageGrid, FindsTheCellOfAPosition) {
  const ImageGrid grid({640, 480}, 8);
  EXPECT_EQ(grid.Cell(-0.5, -0.5), 0U);
  EXPECT_EQ(grid.Cell(79.4, 79.4), 0U);
  EXPECT_EQ(grid.Cell(79.6, 0), 1U);
  EXPECT_EQ(grid.Cell(0, 79.6), 8U);
  EXPECT_EQ(grid.Cell(639, 479), 47U);
  EXPECT_EQ(grid.Cell(-100, 1000), 40U);
  EXPECT_EQ(grid.Cell(1000, -100), 7U);
}

TEST(ImageGrid, HasEachMiddleInItsCell) {
  const ImageGrid grid({640, 480}, 8);
  EXPECT_EQ(grid.Middle(0), Eigen::Vector2d(39.5, 39.5));
  EXPECT_EQ(grid.Middle(9), Eigen::Vector2d(119.5, 119.5));
  const ImageGrid uneven({333, 127}, 7);
  for (size_t cell = 0; cell < uneven.Cells(); ++cell) {
    const Eigen::Vector2d middle = uneven.Middle(cell);
    EXPECT_EQ(uneven.Cell(middle.x(), middle.y()), cell);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
