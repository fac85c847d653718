// SPDX-License-Identifier: Apache-2.0
#include "calib/base/linear_algebra.h"

#include <gtest/gtest.h>

namespace plenocal::testing {
namespace TEST_FILE {

TEST(RotationBetween, IsARotationThatMapsOneDirectionToTheOther) {
  const Eigen::Vector3d x(1, 0, 0), skew(0.3, -2, 0.7);
  for (const auto& [from, to] : {std::pair<Eigen::Vector3d, Eigen::Vector3d>{x, skew},
                                 {skew, x},
                                 {skew, 3 * skew},
                                 {skew, -skew},
                                 {x, Eigen::Vector3d(-1, 1e-5, 0)}}) {
    const Eigen::Matrix3d R = RotationBetween(from, to);
    EXPECT_NEAR((R * from.normalized() - to.normalized()).norm(), 0, 1e-9);
    EXPECT_NEAR((R * R.transpose() - Eigen::Matrix3d::Identity()).norm(), 0, 1e-9);
    EXPECT_NEAR(R.determinant(), 1, 1e-9);
  }
}

TEST(LeastSquares, HasTheLeastNormAmongItsMinima) {
  Eigen::MatrixXd A(3, 2);  // the sum of both unknowns is known, their difference is not
  A << 1, 1, 2, 2, 3, 3;
  const Eigen::VectorXd x = LeastSquares(A, Eigen::VectorXd(Eigen::Vector3d(2, 4, 6)));
  EXPECT_NEAR(x[0], 1, 1e-12);
  EXPECT_NEAR(x[1], 1, 1e-12);
}

TEST(RobustLeastSquares, DoesNotFollowAWrongRow) {
  constexpr double kNoise = 1e-3;
  const Eigen::Vector2d line(2, -0.5);
  Eigen::MatrixXd A(9, 2);
  for (Eigen::Index i = 0; i < A.rows(); ++i) A.row(i) << 1, static_cast<double>(i);
  Eigen::MatrixXd B = A * line;
  for (Eigen::Index i = 0; i < B.rows(); ++i) B(i) += i % 2 == 0 ? kNoise : -kNoise;
  B(3) += 10;
  EXPECT_NEAR((RobustLeastSquares(A, B, 3) - line).norm(), 0, 2 * kNoise);
  B = A * line;
  EXPECT_NEAR((RobustLeastSquares(A, B, 3) - line).norm(), 0, 1e-12);
}

TEST(SolveSymmetric, SolvesForEachColumn) {
  const Eigen::MatrixXd root = Eigen::MatrixXd::Random(6, 6), X = Eigen::MatrixXd::Random(6, 3);
  const Eigen::Matrix<double, 6, 6> A =
      root * root.transpose() + Eigen::Matrix<double, 6, 6>::Identity();
  EXPECT_NEAR((SolveSymmetric(A, Eigen::MatrixXd(A * X)) - X).norm(), 0, 1e-10);
  EXPECT_NEAR((SolveSymmetric(Eigen::MatrixXd(A), Eigen::MatrixXd(A * X)) - X).norm(), 0, 1e-10);
  EXPECT_NEAR((*SolvePositive(A, Eigen::MatrixXd(A * X)) - X).norm(), 0, 1e-10);
  EXPECT_FALSE(SolvePositive(Eigen::Matrix<double, 6, 6>(-A), Eigen::MatrixXd(X)).has_value());
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
