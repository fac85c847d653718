// SPDX-License-Identifier: Apache-2.0
#include "calib/files/checks/correlation_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>

namespace plenocal {
namespace TEST_FILE {

using ::testing::AnyOf;
using ::testing::StartsWith;

constexpr double kRounding = 1e-6;

std::string Defect(const Eigen::MatrixXd& matrix) {
  static const std::array<std::string, 3> kNames{"a", "b", "c"};
  return CorrelationDefect(matrix, kNames, kRounding).value_or("none");
}

Eigen::Matrix3d Correlations(double ab, double ac, double bc) {
  Eigen::Matrix3d matrix;
  matrix << 1, ab, ac, ab, 1, bc, ac, bc, 1;
  return matrix;
}

TEST(CorrelationDefect, IsNoneOfAnyCovariance) {
  EXPECT_EQ(Defect(Correlations(0, 0, 0)), "none");
  EXPECT_EQ(Defect(Correlations(0.9, 0.8, 0.95)), "none");
  EXPECT_EQ(Defect(Correlations(-1, 1, -1)), "none") << "of one unknown three times";
  Eigen::Matrix3d without_b = Correlations(0, 0.5, 0);
  without_b(1, 1) = 0;
  EXPECT_EQ(Defect(without_b), "none");
  EXPECT_EQ(Defect(Eigen::MatrixXd()), "none");
}

TEST(CorrelationDefect, IsNoneOfRoundedNumbers) {
  Eigen::Matrix3d matrix = Correlations(1 + 0.9 * kRounding, 1, 1 - 0.9 * kRounding);
  matrix(0, 0) += 0.9 * kRounding;
  matrix(2, 1) = 1 + 0.9 * kRounding;
  EXPECT_EQ(Defect(matrix), "none");
}

TEST(CorrelationDefect, IsWhatNoCovarianceHas) {
  Eigen::Matrix3d matrix = Correlations(0, 0, 0);
  matrix(1, 1) = 0.5;
  EXPECT_EQ(Defect(matrix), "the correlation of b and b is 0.5, not 1");
  matrix(1, 1) = 1 + 2 * kRounding;
  EXPECT_THAT(Defect(matrix), StartsWith("the correlation of b and b is 1.00000"));
  EXPECT_EQ(Defect(Correlations(0, 1.5, 0)),
            "the correlation of a and c is 1.5, which is not from -1 to 1");
  EXPECT_EQ(Defect(Correlations(-1.25, 0, 0)),
            "the correlation of a and b is -1.25, which is not from -1 to 1");
  EXPECT_EQ(Defect(Correlations(0, 0, std::nan(""))),
            "the correlation of b and c is nan, which is not from -1 to 1");
  matrix = Correlations(0.5, 0, 0);
  matrix(1, 0) = 0.25;
  EXPECT_EQ(Defect(matrix), "the correlation of a and b is 0.5 in one place and 0.25 in the other");
  matrix(1, 0) = 0.5 + 4 * kRounding;
  EXPECT_THAT(Defect(matrix), StartsWith("the correlation of a and b is 0.5 in one place"));
  Eigen::Matrix3d part_of_a_row = Correlations(0, 0, 0.5);
  part_of_a_row(1, 1) = 0;
  EXPECT_EQ(Defect(part_of_a_row), "the correlation of b and b is 0, not 1");
}

// Each is possible, all together are not: a is like b and like c, which are opposite.
TEST(CorrelationDefect, NamesThePairThatContradictsMost) {
  const std::string rest =
      " contradicts those with others: a combination of the unknowns would have a negative variance "
      "(-0.";
  EXPECT_THAT(Defect(Correlations(0.9, 0.8, -0.95)),
              AnyOf(StartsWith("the correlation of b and c" + rest),
                    StartsWith("the correlation of c and b" + rest)));
  EXPECT_THAT(Defect(Correlations(-0.95, 0.8, 0.9)),
              AnyOf(StartsWith("the correlation of a and b" + rest),
                    StartsWith("the correlation of b and a" + rest)));
  // At the limit: positive definite up to ab = 0.6 * 0.8 + 0.8 * 0.6.
  EXPECT_EQ(Defect(Correlations(0.9599, 0.6, 0.8)), "none");
  EXPECT_NE(Defect(Correlations(0.9601, 0.6, 0.8)), "none");
}

}  // namespace TEST_FILE
}  // namespace plenocal
