// SPDX-License-Identifier: Apache-2.0
#include "calib/base/invert_map.h"

#include <gtest/gtest.h>

#include <cmath>

namespace TEST_FILE {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using plenocal::InvertMap;

// p (1 - |p|^2 / 3), which folds at |p| = 1.
bool Barrel(const Vector2d& p, Vector2d* image, Matrix2d* slope) {
  *image = p * (1 - p.squaredNorm() / 3);
  *slope = (1 - p.squaredNorm() / 3) * Matrix2d::Identity() - 2.0 / 3 * p * p.transpose();
  return p.norm() < 1;
}

TEST(InvertMap, FindsThePlaceOfAnImage) {
  for (const double radius : {0.0, 0.5, 0.9, 0.999}) {
    const Vector2d place(0.6 * radius, 0.8 * radius);
    Vector2d image;
    Matrix2d slope;
    Barrel(place, &image, &slope);
    const auto found = InvertMap(Barrel, image, Vector2d(0.1, 0.1), 1e-9);
    ASSERT_TRUE(found.has_value()) << radius;
    EXPECT_LT((*found - place).norm(), 1e-12) << radius;
  }
}

TEST(InvertMap, HasNothingBeyondTheDomain) {
  EXPECT_FALSE(InvertMap(Barrel, Vector2d(0.7, 0), Vector2d(0, 0), 1e-9).has_value());
  EXPECT_FALSE(InvertMap(Barrel, Vector2d(0.1, 0), Vector2d(2, 0), 1e-9).has_value());
  EXPECT_FALSE(InvertMap(Barrel, Vector2d(NAN, 0), Vector2d(0, 0), 1e-9).has_value());
}

TEST(InvertMap, NeedsNoExactSlope) {
  const auto map = [](const Vector2d& p, Vector2d* image, Matrix2d* slope) {
    const bool inside = Barrel(p, image, slope);
    *slope = Matrix2d::Identity();
    return inside;
  };
  const Vector2d image = Vector2d(0.3, -0.2) * (1 - 0.13 / 3);
  const auto found = InvertMap(map, image, image, 1e-12);
  ASSERT_TRUE(found.has_value());
  EXPECT_LT((*found - Vector2d(0.3, -0.2)).norm(), 1e-11);
}

TEST(InvertMap, TakesMapsOfTheLine) {
  using Number = Eigen::Vector<double, 1>;
  const auto cube = [](const Number& x, Number* image, Number* slope) {
    *image = x.array().cube();
    *slope = 3 * x.array().square();
    return true;
  };
  const auto found = InvertMap<1>(cube, Number(8.0), Number(1.0), 1e-9);
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR((*found)[0], 2, 1e-14);
}

}  // namespace TEST_FILE
