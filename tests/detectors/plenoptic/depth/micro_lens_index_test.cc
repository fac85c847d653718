// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/micro_lens_index.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <utility>

#include "tests/detectors/plenoptic/plenoptic_scene.h"

namespace plenocal::internal {
namespace TEST_FILE {

TEST(MicroLensIndex, FindsTheNearestMicroLens) {
  const MicroLensArray array = PlenopticScene{.pitch = 13.7, .rotation = 0.4}.Array();
  const MicroLensIndex index(array);
  // px: the index holds for the middle of cells of 2 x 2 pixels, at most sqrt(2) away.
  const double twice_to_the_middle = 2 * std::sqrt(2.0);
  int exact = 0, points = 0;
  for (double y = 22.3; y < array.image_size[1] - 20; y += 7.1) {
    for (double x = 21.7; x < array.image_size[0] - 20; x += 6.3) {
      const Eigen::Vector2d point(x, y);
      double least = 1e9;
      int best = -1;
      for (size_t i = 0; i < array.lenses.size(); ++i) {
        const double distance = (array.lenses[i].centre - point).norm();
        if (distance < least) least = distance, best = static_cast<int>(i);
      }
      const int found = index.Nearest(point);
      ASSERT_GE(found, 0);
      EXPECT_LE((array.lenses[found].centre - point).norm(), least + twice_to_the_middle);
      exact += found == best ? 1 : 0;
      ++points;
    }
  }
  // Only points on the border between two cells may get the other one.
  EXPECT_GT(exact, points * 0.8);
  EXPECT_GT(points, 2500);
}

TEST(MicroLensIndex, HasNothingOutsideOfTheLattice) {
  MicroLensArray array = PlenopticScene{}.Array();
  std::erase_if(array.lenses, [](const MicroLens& lens) { return lens.centre.x() > 200; });
  const MicroLensIndex index(array);
  EXPECT_EQ(index.Nearest({300, 200}), -1);
  EXPECT_GE(index.Nearest({100, 200}), 0);
}

TEST(MicroLensIndex, FindsNeighboursByTheirDirection) {
  const MicroLensArray array = PlenopticScene{.rotation = -0.2}.Array();
  const MicroLensIndex index(array);
  const int middle = index.Nearest({200, 200});
  for (const LatticeStep step : {LatticeStep{1, 0}, {0, 1}, {-1, 1}, {-2, 1}, {3, -2}}) {
    const int other = index.Neighbour(middle, step);
    ASSERT_GE(other, 0);
    const Eigen::Vector2d expected =
        array.lenses[middle].centre + step.column * array.e_column + step.row * array.e_row;
    EXPECT_LT((array.lenses[other].centre - expected).norm(), 1e-9);
  }
  EXPECT_EQ(index.Neighbour(middle, {1000, 0}), -1);
}

TEST(MicroLensIndex, HasNoNeighbourInAHole) {
  MicroLensArray array = PlenopticScene{}.Array();
  const MicroLensIndex whole(array);
  const int middle = whole.Nearest({200, 200});
  const MicroLens lens = array.lenses[middle];
  std::erase_if(array.lenses, [&](const MicroLens& other) {
    return other.row == lens.row && other.column == lens.column + 1;
  });
  const MicroLensIndex index(array);
  EXPECT_EQ(index.Neighbour(index.Nearest(lens.centre), {1, 0}), -1);
  EXPECT_GE(index.Neighbour(index.Nearest(lens.centre), {-1, 0}), 0);
}

TEST(StepsWithin, HasTheRingsOfAHexagonalLattice) {
  // Rings at 1, sqrt(3) and 2 pitches, six each.
  const MicroLensArray array = PlenopticScene{.rotation = 0.3}.Array();
  EXPECT_EQ(StepsWithin(array, 0.9).size(), 0u);
  EXPECT_EQ(StepsWithin(array, 1.0).size(), 6u);
  EXPECT_EQ(StepsWithin(array, 1.75).size(), 12u);
  EXPECT_EQ(StepsWithin(array, 2.0).size(), 18u);
}

TEST(StepsWithin, IsSymmetricAndShortestFirst) {
  const MicroLensArray array = PlenopticScene{.rotation = 1.1}.Array();
  const auto steps = StepsWithin(array, 3.2);
  ASSERT_GT(steps.size(), 30u);
  std::set<std::pair<int, int>> all;
  double last = 0;
  for (const LatticeStep& step : steps) {
    all.insert({step.column, step.row});
    const double length = (step.column * array.e_column + step.row * array.e_row).norm();
    EXPECT_GT(length, last - 1e-9);
    last = length;
  }
  EXPECT_EQ(all.size(), steps.size());
  for (const auto& [column, row] : all) {
    // Turned by 60 degrees: e_column -> e_row, e_row -> e_row - e_column.
    EXPECT_TRUE(all.contains({-row, column + row})) << column << " " << row;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
