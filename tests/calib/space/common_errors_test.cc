// SPDX-License-Identifier: Apache-2.0
//
// What points share: the error of the calibration, the jitter of their frame, the distances of a
// rigid scene.
#include "calib/space/common_errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <array>
#include <vector>

#include "calib/base/linear_algebra.h"
#include "calib/space/congruent_points.h"
#include "calib/space/measures.h"
#include "tests/calib/space/uncertain_rig.h"

namespace plenocal {
namespace TEST_FILE {

using namespace testing;  // NOLINT

TEST(CommonErrors, NamesAnErrorThatAllPointsShareAndNoSinglePointShows) {
  const SpaceRig rig = MakeSpaceRig(UncertainRig({.calibration = 0.1}), {});
  std::vector<BundleCamera> shifted = rig.cameras;
  shifted[1].params[3] += 0.1;  // c_y: rays pass each other
  Random random(3);
  std::vector<SpacePoint> points;
  int alone = 0;
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d X(random.Uniform(-0.3, 0.3), random.Uniform(-0.2, 0.2), 1.5);
    points.push_back(FitPoint(rig, Seen(shifted, X, 1, 0, &random)));
    alone += points.back().probability < 5e-4 ? 1 : 0;
  }
  EXPECT_LT(alone, 40);
  EXPECT_LT(CommonErrors(points).Test().probability, 1e-9);
}

// One error u and one point: z' (I + b b')^-1 z = |z|^2 - (b'z)^2 / (1 + |b|^2).
TEST(CommonErrors, OfOneUnknownHaveTheChiSquareOfTheirCovariance) {
  SpacePoint point;
  point.misses.resize(3);
  point.misses_by_calibration.resize(3, 1);
  point.misses << 2, -1, 3;
  point.misses_by_calibration << 1, 0.5, -2;
  const RaysTest test = CommonErrors(std::array{point}).Test();
  EXPECT_EQ(test.degrees, 3);
  EXPECT_NEAR(test.chi_square, 14 - 4.5 * 4.5 / (1 + 5.25), 1e-12);
  // An error that is known so badly explains all, up to rounding.
  for (int i = 1; i <= 100; ++i) {
    point.misses = (1 + i / 7.0) * Eigen::Vector3d(2, -1, 3);
    point.misses_by_calibration = 1e9 * point.misses;
    EXPECT_GE(CommonErrors(std::array{point}).Test().chi_square, 0);
  }
}

// Two frames of one calibration: the jitter of one is not that of the other.
TEST(CommonErrors, FramesHaveTheirOwnJitter) {
  const RigOptions options{.calibration = 0.1, .jitter = {3e-4, 2e-3}};
  SpaceRig rig = MakeSpaceRig(UncertainRig(options), {});
  rig.centre = {0, 0, 1};
  Random random(4);
  double sum = 0;
  int degrees = 0, last = 0;
  constexpr int kDraws = 200;
  for (int draw = 0; draw < kDraws; ++draw) {
    CommonErrors common;
    for (int frame = 0; frame < 2; ++frame) {
      std::vector<BundleCamera> truth = rig.cameras;
      for (BundleCamera& camera : truth) {
        const Eigen::Vector3d w = random.Gaussians<3>(2e-3), v = random.Gaussians<3>(3e-4);
        const Eigen::Matrix3d R = ExpRotation(w);
        camera.T_camera_rig =
            camera.T_camera_rig * RigidTransform{R, rig.centre - R * rig.centre + v};
      }
      std::vector<SpacePoint> points;
      for (int i = 0; i < 20; ++i) {
        const Eigen::Vector3d X(random.Uniform(-0.2, 0.2), random.Uniform(-0.2, 0.2), 1);
        points.push_back(FitPoint(rig, Seen(truth, X, 1, 0, &random)));
      }
      common.Add(CommonErrors(points));
    }
    sum += common.Test().chi_square;
    degrees += last = common.Test().degrees;
  }
  ExpectOne(sum / degrees, kDraws, last, "rays");
}

TEST(CommonErrors, PointsAdjustTheCalibrationAsFarAsTheyDetermineIt) {
  const SpaceRig rig = MakeSpaceRig(UncertainRig({.calibration = 3}), {});
  Random random(6);
  double theta = 0, at_points = 0, gain = 0;
  constexpr int kDraws = 100, kPoints = 30;
  for (int draw = 0; draw < kDraws; ++draw) {
    Eigen::VectorXd drawn(rig.root.cols());
    for (double& each : drawn) each = random.Gaussian(1);
    const std::vector<BundleCamera> truth = Moved(rig, rig.root * drawn);
    std::vector<std::vector<SpaceObservation>> seen;
    std::vector<Eigen::Vector3d> at;
    for (int i = 0; i < kPoints; ++i) {
      at.emplace_back(random.Uniform(-0.3, 0.3), random.Uniform(-0.2, 0.2), random.Uniform(0.8, 2));
      seen.push_back(Seen(truth, at.back(), 1, 0, &random));
    }
    const AdjustedRig adjusted = AdjustedTo(rig, seen, 1);
    const Eigen::VectorXd error =
        adjusted.rig.root.partialPivLu().solve(adjusted.change - rig.root * drawn);
    theta += error.squaredNorm() / static_cast<double>(error.size());
    const auto n = static_cast<Eigen::Index>(3 * kPoints);
    Eigen::VectorXd miss(n);
    Eigen::MatrixXd root(n, rig.root.cols()), covariance = Eigen::MatrixXd::Zero(n, n);
    for (Eigen::Index i = 0; i < kPoints; ++i) {
      const auto k = static_cast<size_t>(i);
      const SpacePoint point = FitPoint(adjusted.rig, seen[k]), before = FitPoint(rig, seen[k]);
      ASSERT_TRUE(point.IsFound());
      miss.segment<3>(3 * i) = point.position - at[k];
      root.middleRows(3 * i, 3) = point.shared;
      covariance.block<3, 3>(3 * i, 3 * i) = point.noise;
      gain += before.shared.norm() / point.shared.norm() / (kDraws * kPoints);
    }
    covariance += root * root.transpose();
    at_points += miss.dot(covariance.ldlt().solve(miss)) / static_cast<double>(n);
  }
  ExpectOne(theta / kDraws, kDraws, static_cast<int>(rig.root.cols()), "theta");
  ExpectOne(at_points / kDraws, kDraws, 3 * kPoints, "points");
  EXPECT_GT(gain, 1.05);
}

// After the last step another one would change nothing.
TEST(CommonErrors, AdjustmentGoesOnUntilItIsItsOwnSolution) {
  const SpaceRig rig = MakeSpaceRig(UncertainRig({.calibration = 30}), {});
  Random random(6);
  Eigen::VectorXd drawn(rig.root.cols());
  for (double& each : drawn) each = random.Gaussian(1);
  const std::vector<BundleCamera> truth = Moved(rig, rig.root * drawn);
  std::vector<std::vector<SpaceObservation>> seen;
  for (int i = 0; i < 40; ++i) {
    const Eigen::Vector3d X(
        random.Uniform(-0.3, 0.3), random.Uniform(-0.2, 0.2), random.Uniform(0.8, 2));
    seen.push_back(Seen(truth, X, 1, 0, &random));
  }
  const AdjustedRig adjusted = AdjustedTo(rig, seen, 1);
  const Eigen::VectorXd u = LeastSquares(rig.root, Eigen::VectorXd(adjusted.change));
  EXPECT_GT(u.norm(), 1);
  SpaceRig moved = adjusted.rig;
  moved.root = rig.root;
  std::vector<SpacePoint> points;
  for (const std::vector<SpaceObservation>& of_point : seen) {
    points.push_back(FitPoint(moved, of_point));
  }
  EXPECT_LT((CommonErrors(points).Estimate(u) - u).norm(), 1e-3);
}

TEST(CongruentPoints, HaveTheStandardErrorsOfAllFramesTogether) {
  for (const double jitter : {0.0, 2e-4}) {
    SCOPED_TRACE(jitter);
    const SpaceRig at_rest =
        MakeSpaceRig(UncertainRig({.calibration = 0.5, .jitter = {jitter, 1e-9}}), {});
    Random random(8);
    constexpr int kDraws = 100, kFrames = 4, kPoints = 10;
    double sum = 0, one_frame = 0, together = 0;
    for (int draw = 0; draw < kDraws; ++draw) {
      Eigen::VectorXd drawn(at_rest.root.cols());
      for (double& each : drawn) each = random.Gaussian(1);
      const std::vector<BundleCamera> truth = Moved(at_rest, at_rest.root * drawn);
      std::vector<Eigen::Vector3d> at;
      for (int i = 0; i < kPoints; ++i) {
        at.emplace_back(
            random.Uniform(-0.3, 0.3), random.Uniform(-0.2, 0.2), random.Uniform(-0.1, 0.1));
      }
      std::vector<std::vector<SpacePoint>> points(kFrames);
      std::vector<PointsOfFrame> frames(kFrames);
      RigidTransform first;
      for (int f = 0; f < kFrames; ++f) {
        const RigidTransform T{ExpRotation(random.Gaussians<3>(0.3)),
                               Eigen::Vector3d(0, 0, 1.2) + random.Gaussians<3>(0.1)};
        if (f == 0) first = T;
        std::vector<BundleCamera> cameras = truth;
        for (BundleCamera& camera : cameras) {
          camera.T_camera_rig.t += camera.T_camera_rig.R * random.Gaussians<3>(jitter);
        }
        SpaceRig rig = at_rest;
        rig.centre = T.t;
        for (const Eigen::Vector3d& X : at) {
          points[static_cast<size_t>(f)].push_back(
              FitPoint(rig, Seen(cameras, T * X, 1, 0, &random)));
          ASSERT_TRUE(points[static_cast<size_t>(f)].back().IsFound())
              << points[static_cast<size_t>(f)].back().reason;
        }
        for (int i = 0; i < kPoints; ++i)
          frames[static_cast<size_t>(f)][i] =
              &points[static_cast<size_t>(f)][static_cast<size_t>(i)];
      }
      const CongruentPoints all = AdjustCongruent(frames);
      ASSERT_THAT(all.used, ::testing::Each(true));
      // Distances do not depend on the frame.
      std::vector<Eigen::RowVectorXd> by;
      std::vector<double> errors;
      for (int i = 1; i < kPoints; ++i) {
        const SpacePoint &a = all.points.at(i - 1), &b = all.points.at(i);
        const Eigen::Vector3d u = (b.position - a.position).normalized();
        by.push_back(u.transpose() * (b.shared - a.shared));
        errors.push_back((b.position - a.position).norm() -
                         (at[static_cast<size_t>(i)] - at[static_cast<size_t>(i) - 1]).norm());
        one_frame +=
            LengthOf(points[0][static_cast<size_t>(i) - 1], points[0][static_cast<size_t>(i)])
                .Sigma();
        together += by.back().norm();
      }
      Eigen::MatrixXd root(std::ssize(by), by[0].size());
      for (size_t i = 0; i < by.size(); ++i) root.row(static_cast<Eigen::Index>(i)) = by[i];
      const Eigen::Map<const Eigen::VectorXd> error(errors.data(), std::ssize(errors));
      sum += error.dot((root * root.transpose()).ldlt().solve(error)) / (kPoints - 1);
    }
    ExpectOne(sum / kDraws, kDraws, kPoints - 1, "distances");
    EXPECT_LT(together, 0.7 * one_frame);
  }
}

TEST(CongruentPoints, FramesWithoutCommonPointsAreLeftOut) {
  const SpaceRig rig = MakeSpaceRig(UncertainRig({}), {});
  Random random(9);
  std::vector<SpacePoint> points;
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector3d X(random.Uniform(-0.3, 0.3), random.Uniform(-0.2, 0.2), 1);
    points.push_back(FitPoint(rig, Seen(rig.cameras, X, 1, 0, &random)));
  }
  const CongruentPoints all =
      AdjustCongruent({{{0, &points[0]}, {1, &points[1]}, {2, &points[2]}, {3, &points[3]}},
                       {{3, &points[3]}, {4, &points[4]}, {5, &points[5]}},
                       {{1, &points[1]}, {2, &points[2]}, {3, &points[3]}, {6, &points[6]}}});
  EXPECT_THAT(all.used, ::testing::ElementsAre(true, false, true));
  EXPECT_EQ(all.points.size(), 5U);
  EXPECT_TRUE(AdjustCongruent({}).points.empty());
}

}  // namespace TEST_FILE
}  // namespace plenocal
