// SPDX-License-Identifier: Apache-2.0
#include "calib/scene/segment_covariance.h"

#include <gtest/gtest.h>

#include "tests/calib/random.h"

namespace plenocal {
namespace TEST_FILE {

using testing::Random;

PathSegment RandomSegment(unsigned seed) {
  Random random(seed);
  PathSegment segment;
  for (int i = 0; i < 20; ++i) segment.positions.push_back(2 * random.Direction());
  segment.centre = Eigen::Vector3d(0.1, -0.2, 0.3);
  return segment;
}

TEST(PathSegment, FitFindsTheSimilarityThatMovedIt) {
  const PathSegment segment = RandomSegment(1);
  const Vector7d moved = (Vector7d() << 1, -2, 3, 4, -5, 6, 7).finished() * 1e-3;
  std::vector<Eigen::Vector3d> dp;
  for (const Eigen::Vector3d& p : segment.positions) {
    const Eigen::Vector3d d = p - segment.centre;
    dp.push_back(moved.head<3>() + moved.segment<3>(3).cross(d) + moved[6] * d);
  }
  EXPECT_LT((segment.Fit(dp) - moved).norm(), 1e-12);
}

TEST(LoopCovariance, FloorIsTheRmsOfRandomAlignments) {
  Random random(2);
  Eigen::Matrix<double, 14, 14> root;
  for (double& value : root.reshaped()) value = random.Gaussian(1e-3);
  LoopCovariance covariance{.segments = root * root.transpose(), .poses = {}};
  const PathSegment start = RandomSegment(3);
  PathSegment end = RandomSegment(4);
  end.centre += Eigen::Vector3d(1, 2, 3);
  const std::vector<Eigen::Vector3d> path{{0, 0, 0}, {10, 0, 0}, {10, 5, -3}};
  constexpr int kTrials = 20000;
  double squares = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    Eigen::Matrix<double, 14, 1> normal;
    for (double& value : normal) value = random.Gaussian(1);
    const Eigen::Matrix<double, 14, 1> change = root * normal;
    for (const Eigen::Vector3d& p : path) {
      squares += (SimilarityEffect(p, end.centre) * change.tail<7>() -
                  SimilarityEffect(p, start.centre) * change.head<7>())
                     .squaredNorm();
    }
  }
  const double rms = std::sqrt(squares / (kTrials * static_cast<double>(path.size())));
  EXPECT_NEAR(covariance.AlignmentFloor(start, end, path) / rms, 1, 0.03);
}

}  // namespace TEST_FILE
}  // namespace plenocal
