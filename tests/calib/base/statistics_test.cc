// SPDX-License-Identifier: Apache-2.0
#include "calib/base/statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace plenocal {
namespace TEST_FILE {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

TEST(Statistics, TailsAndQuantilesAreThoseOfTables) {
  EXPECT_NEAR(ChiSquareTail(3, 7.814728), 0.05, 1e-7);
  EXPECT_NEAR(ChiSquareTail(2.5, 5), 0.1230886, 1e-7);
  EXPECT_NEAR(ChiSquareQuantile(3, 0.05), 7.814728, 1e-6);
  EXPECT_NEAR(FTail(3.708265, 3, 10), 0.05, 1e-7);
  EXPECT_NEAR(FTail(161.4476, 1, 1), 0.05, 1e-7);
  EXPECT_NEAR(StudentTail(2.015048, 5), 0.05, 1e-7);
  EXPECT_NEAR(StudentTail(-2.015048, 5), 0.95, 1e-7);
}

TEST(Statistics, QuantilesAreValues) {
  EXPECT_EQ(Quantile({5, 1, 4, 2, 3}, 0.25), 2);
  EXPECT_EQ(Quantile({5, 1, 4, 2, 3}, 1), 5);
  // Ten values are nine intervals: 0.9 of them is next to the value 8, 0.06 next to 1.
  const std::vector<double> digits{0, 1, 2, 3, 4, 5, 6, 7, 8, 9};
  EXPECT_EQ(Quantile(digits, 0.9), 8);
  EXPECT_EQ(Quantile(digits, 0.06), 1);
  EXPECT_EQ(Quantile(digits, 0.05), 0);
  EXPECT_EQ(Quantile({}, 0.5), 0);
}

TEST(Statistics, TailsAreKnownForSquaresOfAnySize) {
  EXPECT_EQ(ChiSquareTail(2, kInfinite), 0);
  EXPECT_EQ(FTail(kInfinite, 3, 5), 0);
  EXPECT_EQ(FTail(-1e-20, 3, 5), 1);
  EXPECT_EQ(StudentTail(kInfinite, 5), 0);
  EXPECT_EQ(StudentTail(-kInfinite, 5), 1);
  EXPECT_EQ(ChiSquareQuantile(2, 0), kInfinite);
  EXPECT_TRUE(std::isnan(FTail(1, 0, 5)));
  EXPECT_TRUE(std::isnan(ChiSquareTail(2, std::nan(""))));
}

}  // namespace TEST_FILE
}  // namespace plenocal
