// SPDX-License-Identifier: Apache-2.0
#include "assess/target/plane_map.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

namespace plenocal {
namespace TEST_FILE {

// A tilted plane before a camera of 800 px focal length with the distortion 1 + k r^2.
Eigen::Vector2d See(const Eigen::Vector2d& p, double k) {
  const Eigen::Vector3d at(p.x(), 0.9 * p.y(), 1 + 0.4 * p.y() - 0.2 * p.x());
  const Eigen::Vector2d ideal = at.hnormalized();
  return Eigen::Vector2d(320, 240) + 800 * (1 + k * ideal.squaredNorm()) * ideal;
}

PlaneMap::Pairs Grid(double k) {
  PlaneMap::Pairs pairs;
  for (int row = 0; row < 7; ++row) {
    for (int column = 0; column < 9; ++column) {
      const Eigen::Vector2d p(0.1 * (column - 4), 0.1 * (row - 3));
      pairs.Add(p, See(p, k), 1);
    }
  }
  return pairs;
}

TEST(PlaneMap, OfOrderOneIsTheHomography) {
  const PlaneMap::Pairs pairs = Grid(0);
  const auto map = PlaneMap::Fit(pairs, std::vector<double>(pairs.plane.size(), 1.0), 1);
  ASSERT_TRUE(map);
  EXPECT_LT(std::ranges::max(map->Lengths(pairs)), 1e-5);
  const Eigen::Vector2d outside(0.6, -0.5);
  EXPECT_LT(((*map)(outside)-See(outside, 0)).norm(), 1e-4);
}

TEST(PlaneMap, FollowsALensDistortion) {
  const PlaneMap::Pairs pairs = Grid(-0.15);
  const std::vector<double> weights(pairs.plane.size(), 1.0);
  const auto homography = PlaneMap::Fit(pairs, weights, 1),
             smooth = PlaneMap::Fit(pairs, weights, 3);
  ASSERT_TRUE(homography && smooth);
  EXPECT_LT(std::ranges::max(smooth->Lengths(pairs)),
            0.3 * std::ranges::max(homography->Lengths(pairs)));
  EXPECT_LT(std::ranges::max(smooth->Lengths(pairs)), 2);
}

TEST(PlaneMap, LeavesOutliersOut) {
  PlaneMap::Pairs pairs = Grid(-0.05);
  for (const size_t i : {3u, 20u, 41u, 42u, 60u}) pairs.image[i].x() += 40;
  const auto map = PlaneMap::FitRobustly(pairs, 3);
  ASSERT_TRUE(map);
  const std::vector<double> lengths = map->Lengths(pairs);
  EXPECT_EQ(std::ranges::count_if(lengths, [](double length) { return length > 1; }), 5);
  EXPECT_NEAR(lengths[41], 40, 0.5);
}

TEST(PlaneMap, NeedsEnoughPoints) {
  PlaneMap::Pairs pairs = Grid(0);
  pairs.plane.resize(9);
  pairs.image.resize(9);
  pairs.scale.resize(9);
  EXPECT_EQ(PlaneMap::OrderFor(9), 1);
  EXPECT_FALSE(PlaneMap::Fit(pairs, std::vector<double>(9, 1.0), 3));
}

}  // namespace TEST_FILE
}  // namespace plenocal
