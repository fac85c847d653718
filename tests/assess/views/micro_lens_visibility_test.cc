// SPDX-License-Identifier: Apache-2.0
#include "assess/views/micro_lens_visibility.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "tests/assess/views/virtual_lenses.h"

namespace plenocal::testing {
namespace TEST_FILE {

TEST(MicroLensVisibility, ShowsAPointInTheLensesWithinItsDepth) {
  const VirtualLenses made;
  const MicroLensVisibility lenses(made.camera.image_size, 10, made.centres);
  for (const double v : {2.0, -2.0, 3.7, 1.1, 8.0, 29.9, -29.9, 0.5}) {
    for (const Eigen::Vector2d& place : {Eigen::Vector2d(143, 97),
                                         Eigen::Vector2d(3, 5),
                                         Eigen::Vector2d(296, 192),
                                         Eigen::Vector2d(-12, 60),
                                         Eigen::Vector2d(305, 103),
                                         Eigen::Vector2d(180, 212),
                                         Eigen::Vector2d(900, 900)}) {
      const Eigen::Vector3d p(place.x(), place.y(), v);
      std::vector<std::pair<double, double>> expected, found;
      for (const Eigen::Vector2d& centre : made.centres) {
        if ((centre - place).norm() < 4.5 * std::abs(v))
          expected.emplace_back(centre[0], centre[1]);
      }
      const MicroLensVisibility::Seen all = lenses.LensesShowing(made.camera, p, 100000);
      for (const Eigen::Vector2d& centre : all.centres) found.emplace_back(centre[0], centre[1]);
      std::ranges::sort(expected), std::ranges::sort(found);
      EXPECT_EQ(found, expected) << p.transpose();
      EXPECT_EQ(all.all, expected.size());
      EXPECT_LT((all.image - place).norm(), 1e-6);
      for (const size_t most : {size_t{1}, size_t{2}, size_t{5}, size_t{12}}) {
        const MicroLensVisibility::Seen some = lenses.LensesShowing(made.camera, p, most);
        EXPECT_EQ(some.all, expected.size());
        const size_t count = std::min(most, expected.size());
        ASSERT_EQ(some.centres.size(), count);
        for (size_t i = 0; i < count; ++i) {
          EXPECT_EQ(some.centres[i], all.centres[i * all.all / count]);
        }
      }
    }
  }
  for (const double v : {0.0, 30.1, -30.1}) {
    const auto none = lenses.LensesShowing(made.camera, {150, 100, v}, 5);
    EXPECT_EQ(none.all, 0U);
    EXPECT_TRUE(none.centres.empty());
  }
}

TEST(MicroLensVisibility, FindsTheImageByTheLensesBesideIt) {
  VirtualLenses made;
  made.camera.params[0] = 1e-5;
  const MicroLensVisibility lenses(made.camera.image_size, 10, made.centres);
  const auto seen = lenses.LensesShowing(made.camera, {40, 60, 2.5}, 5);
  EXPECT_LT((seen.image - Eigen::Vector2d(40, 60)).norm(), 0.02);
}

TEST(MicroLensVisibility, ShowsNothingWhereTheModelHasNoImage) {
  VirtualLenses made;
  const MicroLensVisibility lenses(made.camera.image_size, 10, made.centres);
  const Eigen::Vector2d tried = made.centres[made.centres.size() / 2];
  for (const double limit : {-5.0, 5.0}) {  // beside both lenses that are tried, and between them
    made.camera.params[2] = tried.x() + limit;
    const auto seen = lenses.LensesShowing(made.camera, {tried.x(), tried.y(), 2}, 5);
    EXPECT_EQ(seen.all, 0U);
    EXPECT_EQ(seen.image, Eigen::Vector2d(0, 0));
  }
}

TEST(MicroLensVisibility, FindsTheNearestMicroImage) {
  std::vector<Eigen::Vector2d> centres;
  for (int row = 0; row < 10; ++row) {
    for (int column = 0; column < 12; ++column) {
      centres.emplace_back(10 * column + (row % 2 == 0 ? 5 : 0), 9 * row + 4);
    }
  }
  const MicroLensVisibility lenses({120, 90}, 10, centres);
  EXPECT_TRUE(lenses.HasLenses());
  EXPECT_FALSE(MicroLensVisibility().HasLenses());
  EXPECT_EQ(lenses.Nearest({46, 3}), Eigen::Vector2d(45, 4));
  EXPECT_EQ(lenses.Nearest({1000, 1000}), Eigen::Vector2d(110, 85));
  MicroLensArray array;
  array.image_size = {120, 90};
  array.e_column = {10, 0}, array.e_row = {5, 9};
  array.lenses.resize(2);
  array.lenses[0].centre = {20, 20};
  array.lenses[0].usable = false;
  array.lenses[1].centre = {80, 50};
  EXPECT_EQ(MicroLensVisibility(array).Nearest({20, 20}), Eigen::Vector2d(80, 50));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
