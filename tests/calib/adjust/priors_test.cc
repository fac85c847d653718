// SPDX-License-Identifier: Apache-2.0
#include "calib/adjust/priors.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/calib/random.h"

namespace plenocal::internal {
namespace TEST_FILE {

// Landmarks 0 to 7, of which 3 and 6 have no unknowns.
BundleState Landmarks() {
  testing::Random random(3);
  BundleState bundle;
  for (int i = 0; i < 8; ++i) {
    bundle.markers.push_back(
        {.number = i, .position = random.Direction(), .nominal = Eigen::Vector3d::Zero()});
  }
  bundle.distances = {
      {.markers_a = {2, 4, 7}, .markers_b = {5}, .length = 0.7, .sigma = 0.01},
      {.markers_a = {2}, .markers_b = {4}, .length = 0.2, .sigma = 0.003, .common_sigma = 0.004},
      {.markers_a = {4, 6}, .markers_b = {7}, .length = 0.1, .sigma = 0.001},
      {.markers_a = {4}, .markers_b = {7}, .length = 0.4, .sigma = 0.006, .common_sigma = 0.008}};
  return bundle;
}

int First(int marker) { return marker == 3 || marker == 6 ? -1 : 10 + 3 * marker; }

TEST(RowsOfDistances, AreTheDistancesOfMeansInStandardErrors) {
  const BundleState bundle = Landmarks();
  const std::vector<SparseRow> rows = RowsOfDistances(bundle, {}, First, bundle);
  ASSERT_EQ(rows.size(), 3U);
  const auto p = [&](size_t marker) { return bundle.markers[marker].position; };
  EXPECT_NEAR(rows[0].residual, (((p(2) + p(4) + p(7)) / 3 - p(5)).norm() - 0.7) / 0.01, 1e-9);
  // chi-square of two that share an error, by the inverse of their covariance.
  const Eigen::Vector2d d((p(2) - p(4)).norm() - 0.2, (p(4) - p(7)).norm() - 0.4);
  Eigen::Matrix2d C;
  C << 0.003 * 0.003 + 0.004 * 0.004, 0.004 * 0.008, 0.004 * 0.008, 0.006 * 0.006 + 0.008 * 0.008;
  const Eigen::Vector2d of_two(rows[1].residual, rows[2].residual);
  EXPECT_NEAR(of_two.squaredNorm() / d.dot(C.inverse() * d), 1, 1e-9);
}

TEST(RowsOfDistances, HaveTheDerivativesOfTheirResiduals) {
  BundleState bundle = Landmarks();
  const std::vector<SparseRow> rows = RowsOfDistances(bundle, {}, First, bundle);
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 24; ++i) {
    const auto marker = static_cast<size_t>(i / 3);
    double& value = bundle.markers[marker].position[i % 3];
    value += kStep;
    const std::vector<SparseRow> above = RowsOfDistances(bundle, {}, First, bundle);
    value -= 2 * kStep;
    const std::vector<SparseRow> below = RowsOfDistances(bundle, {}, First, bundle);
    value += kStep;
    for (size_t r = 0; r < rows.size(); ++r) {
      double expected = 0;
      for (const auto& [unknown, J] : rows[r].J) expected += unknown == 10 + i ? J : 0;
      EXPECT_NEAR((above[r].residual - below[r].residual) / (2 * kStep),
                  expected,
                  1e-5 * (1 + std::abs(expected)))
          << r << " " << i;
    }
  }
}

TEST(RowsOfDistances, RefuseEndsAtOnePlace) {
  BundleState bundle = Landmarks();
  bundle.markers[7].position = bundle.markers[4].position;
  const std::vector<SparseRow> rows = RowsOfDistances(bundle, {}, First, bundle);
  ASSERT_EQ(rows.size(), 3U);
  EXPECT_FALSE(std::isfinite(rows[2].residual));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
