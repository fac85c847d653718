// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/priors.h"

#include <gtest/gtest.h>

#include "tests/calib/random.h"

namespace plenocal::internal {
namespace TEST_FILE {

std::vector<MarkerDistance> Distances() {
  return {
      {.markers_a = {2, 4, 7}, .markers_b = {5}, .length = 0.7, .sigma = 0.01},
      {.markers_a = {2}, .markers_b = {4}, .length = 0.2, .sigma = 0.003, .common_sigma = 0.004},
      {.markers_a = {4}, .markers_b = {7}, .length = 0.4, .sigma = 0.006, .common_sigma = 0.008}};
}

std::vector<Eigen::Vector3d> Positions() {
  testing::Random random(3);
  std::vector<Eigen::Vector3d> positions;
  for (int i = 0; i < 4; ++i) positions.push_back(random.Direction());
  return positions;
}

TEST(DistanceRows, AreTheDistancesOfMeansInStandardErrors) {
  const DistanceRows rows(Distances());
  ASSERT_EQ(rows.Markers(), (std::vector<int>{2, 4, 5, 7}));
  const std::vector<Eigen::Vector3d> p = Positions();
  Eigen::VectorXd residual;
  Eigen::MatrixXd J;
  ASSERT_TRUE(rows.Evaluate(p, &residual, &J));
  EXPECT_NEAR(residual[0], (((p[0] + p[1] + p[3]) / 3 - p[2]).norm() - 0.7) / 0.01, 1e-9);
  // chi-square of two that share an error, by the inverse of their covariance.
  const Eigen::Vector2d d((p[0] - p[1]).norm() - 0.2, (p[1] - p[3]).norm() - 0.4);
  Eigen::Matrix2d C;
  C << 0.003 * 0.003 + 0.004 * 0.004, 0.004 * 0.008, 0.004 * 0.008, 0.006 * 0.006 + 0.008 * 0.008;
  EXPECT_NEAR(residual.tail<2>().squaredNorm() / d.dot(C.inverse() * d), 1, 1e-9);
}

TEST(DistanceRows, HaveTheDerivativesOfTheirResiduals) {
  const DistanceRows rows(Distances());
  std::vector<Eigen::Vector3d> p = Positions();
  Eigen::VectorXd residual, above, below;
  Eigen::MatrixXd J, other;
  ASSERT_TRUE(rows.Evaluate(p, &residual, &J));
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 12; ++i) {
    double& value = p[static_cast<size_t>(i / 3)][i % 3];
    value += kStep;
    rows.Evaluate(p, &above, &other);
    value -= 2 * kStep;
    rows.Evaluate(p, &below, &other);
    value += kStep;
    EXPECT_LT((J.col(i) - (above - below) / (2 * kStep)).norm(), 1e-5 * (1 + J.col(i).norm())) << i;
  }
}

TEST(DistanceRows, RefuseEndsAtOnePlace) {
  const DistanceRows rows({{.markers_a = {0}, .markers_b = {1}, .length = 1, .sigma = 1}});
  const std::vector<Eigen::Vector3d> same(2, Eigen::Vector3d(1, 2, 3));
  Eigen::VectorXd residual;
  Eigen::MatrixXd J;
  EXPECT_FALSE(rows.Evaluate(same, &residual, &J));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
