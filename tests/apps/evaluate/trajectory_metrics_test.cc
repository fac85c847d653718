// SPDX-License-Identifier: Apache-2.0
//
// The metrics of paths against their definitions.
#include "apps/evaluate/trajectory_metrics.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/error.h"
#include "calib/camera/rigid_transform.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Pair;
using ::testing::ThrowsMessage;

constexpr double kDegrees = 180 / std::numbers::pi;

// A winding path with a pose every second.
Trajectory Path(size_t count, double first = 0) {
  Trajectory path;
  path.path = "path.txt";
  for (size_t i = 0; i < count; ++i) {
    const double t = first + static_cast<double>(i);
    path.times.push_back(t);
    path.positions.emplace_back(std::cos(0.3 * t), std::sin(0.5 * t), 0.1 * t);
    path.orientations.emplace_back(ExpRotation({0.1 * t, -0.05 * t, 0.02 * t}));
  }
  return path;
}

Trajectory Moved(Trajectory path, const Similarity& T) {
  for (Eigen::Vector3d& p : path.positions) p = T * p;
  for (Eigen::Quaterniond& q : path.orientations) q = Eigen::Quaterniond(T.R) * q;
  return path;
}

void AddNoise(Trajectory* path, double sigma) {
  Random random(5);
  for (Eigen::Vector3d& p : path->positions) p += random.Gaussians<3>(sigma);
  for (Eigen::Quaterniond& q : path->orientations) {
    q = q * Eigen::Quaterniond(ExpRotation(random.Gaussians<3>(sigma)));
  }
}

const Similarity kMove{1.1, ExpRotation({0.3, -0.2, 0.5}), {1, 2, -3}};

TEST(Associate, PairsPosesThatAreEachOthersNearest) {
  Trajectory estimate = Path(0), truth = Path(0);
  estimate.times = {0, 1, 2, 2.4, 5};
  truth.times = {0.1, 1.9, 2.45, 5.3};
  EXPECT_THAT(Associate(estimate, truth, 0.2), ElementsAre(Pair(0, 0), Pair(2, 1), Pair(3, 2)));
  EXPECT_THAT(Associate(estimate, truth, 0.35),
              ElementsAre(Pair(0, 0), Pair(2, 1), Pair(3, 2), Pair(4, 3)));
  EXPECT_THAT(Associate(estimate, truth, 0.04), IsEmpty());
  // Of two that are equally near the earlier one.
  estimate.times = {1};
  truth.times = {0.5, 1.5};
  EXPECT_THAT(Associate(estimate, truth, 1), ElementsAre(Pair(0, 0)));
}

TEST(SplitAtLargestGap, NeedsAGapThatStandsOut) {
  Trajectory truth = Path(10);
  EXPECT_FALSE(SplitAtLargestGap(truth));
  for (size_t i = 4; i < 10; ++i) truth.times[i] += 1.5;  // 2.5 against 1
  const auto split = SplitAtLargestGap(truth);
  ASSERT_TRUE(split);
  EXPECT_EQ(split->start.Size(), 4);
  EXPECT_EQ(split->end.Size(), 6);
  EXPECT_EQ(split->end.times.front(), truth.times[4]);
  EXPECT_EQ(split->end.positions.front(), truth.positions[4]);
  EXPECT_EQ(split->end.orientations.size(), 6);
  for (size_t i = 8; i < 10; ++i) truth.times[i] += 0.6;  // 2.5 against 1.6
  EXPECT_FALSE(SplitAtLargestGap(truth));
  // 5 s of 100 s.
  truth = Path(100);
  for (size_t i = 50; i < 100; ++i) truth.times[i] += 4;
  EXPECT_FALSE(SplitAtLargestGap(truth));
  for (size_t i = 50; i < 100; ++i) truth.times[i] += 8;
  EXPECT_TRUE(SplitAtLargestGap(truth));
  EXPECT_FALSE(SplitAtLargestGap(Path(1)));
}

TEST(MeasureDrift, IsThatOfTheTwoAlignments) {
  const Trajectory path = Path(40);
  const Similarity start{1.2, ExpRotation({0.1, 0, 0}), {1, 0, 0}},
      end{1.5, ExpRotation({0.1, 0.2, 0}), {1, 0.4, 0}};
  const LoopMetrics metrics = MeasureDrift(path, start, end);
  EXPECT_NEAR(metrics.ScaleDrift(), 1.5 / 1.2, 1e-12);
  EXPECT_NEAR(metrics.absolute_scale, std::sqrt(1.5 * 1.2), 1e-12);
  EXPECT_NEAR(metrics.ScaleMin() * metrics.ScaleMax(), 1.5 * 1.2, 1e-12);
  EXPECT_NEAR(metrics.ScaleMax() / metrics.ScaleMin(), 1.5 / 1.2, 1e-12);
  const Eigen::Matrix3d turn = end.R * start.R.transpose();
  EXPECT_NEAR(metrics.rotation_drift_deg, Eigen::AngleAxisd(turn).angle() * kDegrees, 1e-9);
  const Eigen::Vector3d shift = end.t - 1.5 / 1.2 * turn * start.t;
  EXPECT_NEAR(metrics.translation_drift, shift.norm(), 1e-12);
  double squares = 0, length = 0;
  for (size_t i = 0; i < path.Size(); ++i) {
    squares +=
        (1.2 * start.R * path.positions[i] + start.t - 1.5 * end.R * path.positions[i] - end.t)
            .squaredNorm();
    if (i > 0) length += (path.positions[i] - path.positions[i - 1]).norm();
  }
  EXPECT_NEAR(metrics.alignment_error, std::sqrt(squares / 40), 1e-12);
  EXPECT_NEAR(metrics.path_length, std::sqrt(1.5 * 1.2) * length, 1e-9);
  EXPECT_EQ(metrics.frames, 40);
  EXPECT_EQ(Folded(0.8), 1.25);
  EXPECT_EQ(Folded(1.25), 1.25);
}

TEST(MeasureLoop, FindsTheSimilaritiesOfTheSegments) {
  const Trajectory path = Path(60);
  const Similarity other{0.9, ExpRotation({0, 0.1, 0}), {0, 1, 0}};
  LoopTruth truth{Moved(Path(10), kMove), Moved(Path(10, 50), other)};
  const LoopMetrics metrics = MeasureLoop(path, truth, 0.01);
  for (const auto& [found, expected] :
       {std::pair(metrics.T_s_gt, kMove), {metrics.T_e_gt, other}}) {
    EXPECT_NEAR(found.s, expected.s, 1e-9);
    EXPECT_LT((found.R - expected.R).norm(), 1e-9);
    EXPECT_LT((found.t - expected.t).norm(), 1e-8);
  }
}

TEST(MeasureLoop, NamesSegmentsThatDetermineNoSimilarity) {
  const Trajectory path = Path(60);
  const auto with_start = [&](const Trajectory& start) {
    return [&path, truth = LoopTruth{start, Path(10, 50)}] { MeasureLoop(path, truth, 0.01); };
  };
  EXPECT_THAT(with_start(Path(2)),
              ThrowsMessage<Error>(HasSubstr("path.txt: start segment: 2 poses of the estimate "
                                             "found in the truth, at least 3 are needed")));
  EXPECT_THAT(with_start(Path(10, 200)),
              ThrowsMessage<Error>(HasSubstr("no pose of the estimate (0.000 to 59.000 s) lies "
                                             "within 0.01 s of one of the truth (200.000")));
  Trajectory rests = Path(10);
  for (Eigen::Vector3d& p : rests.positions) p = {1, 2, 3};
  EXPECT_THAT(with_start(rests), ThrowsMessage<Error>(HasSubstr("the truth does not move")));
  Trajectory line = Path(10);
  for (size_t i = 0; i < 10; ++i) line.positions[i] = {static_cast<double>(i), 0, 0};
  EXPECT_THAT(with_start(line),
              ThrowsMessage<Error>(HasSubstr("the truth moves along a straight line")));
  // Off the line by what the estimate does not show.
  Random random(2);
  for (Eigen::Vector3d& p : line.positions) p += random.Gaussians<3>(0.3);
  EXPECT_THAT(with_start(line), ThrowsMessage<Error>(HasSubstr("up to the estimate's errors")));
}

double RootMeanSquare(const std::vector<double>& values) {
  double squares = 0;
  for (const double value : values) squares += value * value;
  return std::sqrt(squares / static_cast<double>(values.size()));
}

TEST(MeasurePath, IsAteAndRpeByTheirDefinitions) {
  constexpr size_t kCount = 50, kDelta = 3;
  const Trajectory truth = Path(kCount);
  Trajectory estimate = Moved(truth, kMove.Inverse());
  AddNoise(&estimate, 0.02);
  const PathErrors errors = MeasurePath(estimate, truth, 0.01, kDelta);
  EXPECT_EQ(errors.pairs, kCount);
  EXPECT_NEAR(errors.scale, kMove.s, 0.02);
  Eigen::Matrix3Xd from(3, kCount), to(3, kCount);
  for (size_t i = 0; i < kCount; ++i) {
    from.col(static_cast<Eigen::Index>(i)) = estimate.positions[i];
    to.col(static_cast<Eigen::Index>(i)) = truth.positions[i];
  }
  std::vector<double> unaligned, rigid, scaled, turned;
  const Eigen::Matrix4d T_rigid = Eigen::umeyama(from, to, false),
                        T = Eigen::umeyama(from, to, true);
  for (size_t i = 0; i < kCount; ++i) {
    const Eigen::Vector4d p = estimate.positions[i].homogeneous();
    unaligned.push_back((estimate.positions[i] - truth.positions[i]).norm());
    rigid.push_back(((T_rigid * p).head<3>() - truth.positions[i]).norm());
    scaled.push_back(((T * p).head<3>() - truth.positions[i]).norm());
    const Eigen::Matrix3d turn = truth.orientations[i].toRotationMatrix().transpose() *
                                 T_rigid.topLeftCorner<3, 3>() *
                                 estimate.orientations[i].toRotationMatrix();
    turned.push_back(Eigen::AngleAxisd(turn).angle() * kDegrees);
  }
  EXPECT_NEAR(errors.ate_unaligned.rmse, RootMeanSquare(unaligned), 1e-12);
  EXPECT_NEAR(errors.ate_se3.rmse, RootMeanSquare(rigid), 1e-12);
  EXPECT_NEAR(errors.ate_sim3.rmse, RootMeanSquare(scaled), 1e-12);
  EXPECT_NEAR(errors.ate_rotation.rmse, RootMeanSquare(turned), 1e-9);
  EXPECT_LT(errors.ate_sim3.rmse, errors.ate_se3.rmse);
  // All statistics of one list.
  const ErrorStatistics& of = errors.ate_sim3;
  std::ranges::sort(scaled);
  double sum = 0;
  for (const double error : scaled) sum += error;
  EXPECT_NEAR(of.mean, sum / kCount, 1e-12);
  EXPECT_NEAR(of.median, (scaled[24] + scaled[25]) / 2, 1e-12);
  EXPECT_NEAR(of.min, scaled.front(), 1e-12);
  EXPECT_NEAR(of.max, scaled.back(), 1e-12);
  EXPECT_NEAR(of.sse, of.rmse * of.rmse * kCount, 1e-12);
  EXPECT_NEAR(of.std, std::sqrt(of.rmse * of.rmse - of.mean * of.mean), 1e-9);
  // Motions over three poses.
  std::vector<double> steps, scaled_steps, turns;
  for (size_t i = 0; i + kDelta < kCount; ++i) {
    const auto motion = [&](const Trajectory& path, double scale) {
      Eigen::Isometry3d first(path.orientations[i]), second(path.orientations[i + kDelta]);
      first.pretranslate(scale * path.positions[i]);
      second.pretranslate(scale * path.positions[i + kDelta]);
      return first.inverse() * second;
    };
    const Eigen::Isometry3d error = motion(truth, 1).inverse() * motion(estimate, 1),
                            with_scale =
                                motion(truth, 1).inverse() * motion(estimate, errors.scale);
    steps.push_back(error.translation().norm());
    scaled_steps.push_back(with_scale.translation().norm());
    turns.push_back(Eigen::AngleAxisd(error.rotation()).angle() * kDegrees);
  }
  EXPECT_NEAR(errors.rpe_se3.rmse, RootMeanSquare(steps), 1e-12);
  EXPECT_NEAR(errors.rpe_sim3.rmse, RootMeanSquare(scaled_steps), 1e-12);
  EXPECT_NEAR(errors.rpe_rotation.rmse, RootMeanSquare(turns), 1e-9);
}

TEST(MeasurePath, HasTheMiddleOneOfAnOddNumberAsMedian) {
  Trajectory truth = Path(5), estimate = truth;
  estimate.positions[2] += Eigen::Vector3d(0.1, 0, 0);
  const PathErrors errors = MeasurePath(estimate, truth, 0.01, 1);
  EXPECT_EQ(errors.ate_unaligned.median, 0);
  EXPECT_NEAR(errors.ate_unaligned.max, 0.1, 1e-12);
  EXPECT_NEAR(errors.ate_unaligned.mean, 0.02, 1e-12);
}

TEST(MeasurePath, NeedsMorePosesThanDelta) {
  const Trajectory path = Path(5);
  EXPECT_THAT([&] { MeasurePath(path, path, 0.01, 5); },
              ThrowsMessage<Error>(HasSubstr("5 poses found in the truth, too few for --delta 5")));
  EXPECT_EQ(MeasurePath(path, path, 0.01, 4).pairs, 5);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
