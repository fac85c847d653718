// SPDX-License-Identifier: Apache-2.0
#include "calib/scene/segment_covariance.h"

#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <map>

#include "calib/adjust/solver/adjust.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

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

// Adjusted landmarks seen by a known stereo pair.
Bundle AdjustedLoop() {
  constexpr double kNoise = 0.2;  // px
  Random random(5);
  Bundle bundle = testing::TrueBundle(testing::MakeProblem(7, {.cameras = 2, .frames = 10}));
  for (BundleObservation& observation : bundle.observations) {
    observation.assumed_sigma = kNoise;
    for (size_t r = 0; r < 2; ++r) observation.seen.values[r] += random.Gaussian(kNoise);
  }
  bundle.marker_freedom = MarkerFreedom::Landmarks();
  bundle.fixed_frame = 0;
  for (BundleCamera& camera : bundle.cameras) {
    camera.fixed.assign(camera.fixed.size(), true);
    camera.is_master = true;
  }
  EXPECT_TRUE(Adjust(&bundle, {}).usable);
  return bundle;
}

TEST(LoopCovariance, DoesNotDependOnHowFarALandmarkHasConverged) {
  const std::vector<size_t> start{0, 1, 2, 3, 4}, end{5, 6, 7, 8, 9};
  Bundle bundle = AdjustedLoop();
  const LoopCovariance converged = EstimateLoopCovariance(bundle, 0, start, end);
  bundle.markers[3].position += Eigen::Vector3d(2e-4, -1e-4, 3e-4);
  const LoopCovariance moved = EstimateLoopCovariance(bundle, 0, start, end);
  EXPECT_NEAR(moved.track_factor / converged.track_factor, 1, 0.01);
  EXPECT_NEAR(moved.scale_sigma / converged.scale_sigma, 1, 0.01);
}

// Squared error of the end against the start in units of its covariance, over the seven numbers.
// All points of the end are off by an error of their own, and blocks of neighbours by one more.
double NeesWithSharedErrors(unsigned seed) {
  constexpr double kNoise = 0.1;                  // px
  constexpr double kOwn = 3e-4, kOfBlock = 1e-4;  // m; 1e-4 is 0.2 px
  constexpr double kBlock = 0.1;                  // m
  Random random(seed);
  const testing::SyntheticOptions options{
      .shape = testing::TargetShape::kCorner, .cameras = 2, .frames = 10};
  Bundle bundle = testing::TrueBundle(testing::MakeProblem(seed, options));
  const std::vector<size_t> start{0, 1, 2, 3, 4}, end{5, 6, 7, 8, 9};
  const PathSegment true_start = MakeSegment(bundle, 0, start);
  const PathSegment true_end = MakeSegment(bundle, 0, end);
  Bundle displaced = bundle;
  std::map<std::array<int, 3>, Eigen::Vector3d> of_block;
  for (BundleMarker& marker : displaced.markers) {
    std::array<int, 3> block;
    for (size_t i = 0; i < 3; ++i) {
      block[i] = static_cast<int>(marker.position[static_cast<Eigen::Index>(i)] / kBlock);
    }
    const auto [found, added] = of_block.try_emplace(block);
    if (added) found->second = random.Gaussians<3>(kOfBlock);
    marker.position += found->second + random.Gaussians<3>(kOwn);
  }
  for (BundleObservation& seen : bundle.observations) {
    double shift[kMaxObservationSize] = {};
    if (seen.frame >= 5) Residual(displaced, seen, shift);
    seen.assumed_sigma = kNoise;
    for (size_t i = 0; i < 2; ++i) seen.seen.values[i] += random.Gaussian(kNoise) - shift[i];
  }
  bundle.marker_freedom = MarkerFreedom::Landmarks();
  bundle.fixed_frame = 0;
  for (BundleCamera& camera : bundle.cameras) {
    camera.fixed.assign(camera.fixed.size(), true);
    camera.is_master = true;
  }
  EXPECT_TRUE(Adjust(&bundle, {}).usable);
  const auto change = [&](const PathSegment& truth, std::span<const size_t> frames) {
    std::vector<Eigen::Vector3d> dp = MakeSegment(bundle, 0, frames).positions;
    for (size_t i = 0; i < dp.size(); ++i) dp[i] -= truth.positions[i];
    return truth.Fit(dp);
  };
  const Vector7d error = change(true_end, end) - change(true_start, start);
  const LoopCovariance stated = EstimateLoopCovariance(bundle, 0, start, end);
  return error.dot(stated.Relative().ldlt().solve(error)) / 7;
}

TEST(LoopCovariance, ContainsErrorsThatNeighbouringTracksShare) {
  constexpr unsigned kSeeds = 24;
  double sum = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) sum += NeesWithSharedErrors(seed);
  EXPECT_GT(sum / kSeeds, 0.6);
  EXPECT_LT(sum / kSeeds, 1.5);
}

}  // namespace TEST_FILE
}  // namespace plenocal
