// SPDX-License-Identifier: Apache-2.0
#include "calib/noise/matrix_root.h"

#include <gtest/gtest.h>

#include "tests/calib/random.h"

namespace plenocal {
namespace TEST_FILE {

// A matrix of this rank, whose standard deviations are 1e12 apart.
Eigen::MatrixXd Covariance(Eigen::Index rank) {
  testing::Random random(static_cast<unsigned>(rank));
  Eigen::MatrixXd root(4, rank);
  for (double& entry : root.reshaped()) entry = random.Gaussian(1);
  const Eigen::Vector4d sigma(1e-6, 1, 1e3, 1e6);
  root = (sigma.asDiagonal() * root).eval();
  return root * root.transpose();
}

Eigen::MatrixXd WithUnitDiagonal(const Eigen::MatrixXd& matrix, const Eigen::MatrixXd& V) {
  const Eigen::VectorXd scale = V.diagonal().cwiseSqrt().cwiseInverse();
  return scale.asDiagonal() * matrix * scale.asDiagonal();
}

TEST(MatrixRoot, TimesItselfIsTheMatrix) {
  for (const Eigen::Index rank : {2, 4}) {
    const Eigen::MatrixXd V = Covariance(rank), N = Root(V);
    EXPECT_LT(WithUnitDiagonal(N * N.transpose() - V, V).norm(), 1e-12) << rank;
  }
  EXPECT_TRUE(Root(Eigen::MatrixXd::Zero(2, 2)).isZero(0));
  EXPECT_DOUBLE_EQ(Root(Eigen::MatrixXd::Constant(1, 1, 4)).norm(), 2);
  EXPECT_EQ(Root(Eigen::MatrixXd(0, 0)).size(), 0);
}

TEST(MatrixRoot, InverseHasAColumnForEachDirectionWithVariance) {
  for (const Eigen::Index rank : {2, 4}) {
    const Eigen::MatrixXd V = Covariance(rank), N = InverseRoot(V);
    ASSERT_EQ(N.cols(), rank);
    EXPECT_LT((N.transpose() * V * N - Eigen::MatrixXd::Identity(rank, rank)).norm(), 1e-9) << rank;
  }
  EXPECT_EQ(InverseRoot(Eigen::MatrixXd::Zero(2, 2)).cols(), 0);
  EXPECT_DOUBLE_EQ(InverseRoot(Eigen::MatrixXd::Constant(1, 1, 4)).norm(), 0.5);
  EXPECT_EQ(InverseRoot(Eigen::MatrixXd(0, 0)).size(), 0);
}

}  // namespace TEST_FILE
}  // namespace plenocal
