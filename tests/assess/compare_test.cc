// SPDX-License-Identifier: Apache-2.0
#include "assess/compare.h"

#include <gtest/gtest.h>

#include <limits>

#include "calib/base/statistics.h"
#include "calib/estimate/describe.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

constexpr double kNoise = 0.1;  // px

TEST(CompareCameras, NoTranslationMakesUpForAFocalLengthFarAway) {
  CalibratedCamera a{.name = "camera",
                     .model = FindModel(CameraModels(), "pinhole"),
                     .image_size = {640, 480},
                     .config = {},
                     .params = {400, 400, 319.5, 239.5},
                     .covariance = Eigen::MatrixXd::Zero(4, 4),
                     .T_camera_rig = {}};
  CalibratedCamera b = a;
  constexpr double kFactor = 1.01;
  b.params[0] *= kFactor;
  b.params[1] *= kFactor;
  const CameraDifference far = CompareCameras(a, b, {std::numeric_limits<double>::infinity()});
  EXPECT_EQ(far.T_b_a.t.norm(), 0);
  const double radius = std::sqrt((640.0 * 640 + 480.0 * 480) / 12);  // RMS over the image
  EXPECT_NEAR(far.distances[0].all.rms, (kFactor - 1) * radius, 0.02 * (kFactor - 1) * radius);
  // At one distance a shift along the axis does, less off the axis than on it.
  const double shift = CompareCameras(a, b, {2}).T_b_a.t.z() / 2;
  EXPECT_LT(shift, kFactor - 1);
  EXPECT_GT(shift, 0.7 * (kFactor - 1));
}

// By differences: the motion that makes up for a change of a parameter, at distances in metres.
TEST(CompareCameras, MotionHasItsDerivativesByTheParametersOfBoth) {
  CalibratedCamera a{.name = "camera",
                     .model = FindModel(CameraModels(), "pinhole-radial3"),
                     .image_size = {640, 480},
                     .config = {},
                     .params = {500, 500, 319.5, 239.5, -0.2, 0.05, 0},
                     .covariance = Eigen::MatrixXd::Identity(7, 7),
                     .T_camera_rig = {}};
  const std::vector<double> distances{4, 9};
  const CameraDifference difference = CompareCameras(a, a, distances);
  constexpr double kStep = 1e-4;
  for (size_t k = 0; k < 4; ++k) {
    CalibratedCamera changed = a;
    changed.params[k] += kStep;
    const auto column = static_cast<Eigen::Index>(k);
    const Vector6d by_b = LocalCoordinates({}, CompareCameras(a, changed, distances).T_b_a) / kStep;
    const Vector6d by_a = LocalCoordinates({}, CompareCameras(changed, a, distances).T_b_a) / kStep;
    const double size = by_b.norm();
    EXPECT_GT(size, 1e-4) << k;
    EXPECT_LT((difference.T_b_a_by_b.col(column) - by_b).norm(), 0.01 * size) << k;
    EXPECT_LT((difference.T_b_a_by_a.col(column) - by_a).norm(), 0.01 * size) << k;
  }
}

TEST(CompareCameras, WhatIsUnknownInTheCornersDoesNotHideWhatIsKnownInTheMiddle) {
  CalibratedCamera a{.name = "camera",
                     .model = FindModel(CameraModels(), "pinhole-radial3"),
                     .image_size = {640, 480},
                     .config = {},
                     .params = {500, 500, 319.5, 239.5, -0.2, 0.05, 0},
                     .covariance = Eigen::MatrixXd::Zero(7, 7),
                     .T_camera_rig = {}};
  const Eigen::VectorXd sigmas{{1, 1, 1, 1, 0.05, 0.5, 3}};
  a.covariance = sigmas.cwiseAbs2().asDiagonal();
  const std::vector<double> distances{1, std::numeric_limits<double>::infinity()};
  CalibratedCamera b = a;
  for (const size_t k : {4, 5, 6}) b.params[k] += (k == 5 ? -1 : 1) * sigmas[static_cast<int>(k)];
  EXPECT_TRUE(CompareCameras(a, b, distances).same);
  for (const size_t k : {0, 1}) b.params[k] += 8 * sigmas[static_cast<int>(k)];
  const CameraDifference difference = CompareCameras(a, b, distances);
  EXPECT_FALSE(difference.same);
  EXPECT_TRUE(difference.distances[1].parts[4].differs);
}

TEST(ImageSigma, DoesNotDependOnUnits) {
  // Variances of 1e-12 m^2 and of 1e11 m^-8 that belong together.
  CalibratedCamera camera{.name = "camera",
                          .model = FindModel(CameraModels(), "focused-plenoptic"),
                          .image_size = {800, 800},
                          .config = {7.4e-6},
                          .params = {0.0125, 0.012, 0.000244, 399, 401, -224, 1.43e6, 0.03, 0.02},
                          .covariance = Eigen::MatrixXd::Identity(9, 9),
                          .T_camera_rig = {}};
  const auto correlate = [&](int i, int j, double by) {
    camera.covariance(i, j) = camera.covariance(j, i) = by;
  };
  correlate(0, 1, 0.148), correlate(0, 2, 0.798), correlate(1, 2, -0.466);
  correlate(0, 5, -0.199), correlate(1, 5, -0.286), correlate(0, 6, 0.190), correlate(1, 6, 0.280);
  correlate(3, 7, 0.938), correlate(4, 8, 0.946), correlate(5, 6, -0.964);
  const Eigen::VectorXd sigma{
      {1.05e-6, 7.2e-7, 3.57e-7, 0.212, 0.220, 6.42, 4.43e5, 0.00373, 0.00384}};
  camera.covariance = sigma.asDiagonal() * camera.covariance * sigma.asDiagonal();
  const double predicted = ImageSigma(camera, {1});
  EXPECT_GT(predicted, 0.002);
  EXPECT_LT(predicted, 0.01);
}

TEST(CompareExtrinsics, OfCamerasWithoutErrorsHaveNoPrediction) {
  const SyntheticProblem problem = MakeProblem(3, {.cameras = 2, .frames = 10});
  const Calibration calibration = Calibrate(WithNoise(problem.input, kNoise, 100), {});
  std::vector<CalibratedCamera> cameras;
  std::vector<CameraDifference> same;
  for (const size_t c : {0, 1}) {
    cameras.push_back(DescribeCamera(calibration, c));
    cameras[c].covariance.setZero();
    cameras[c].sigma_xi.setZero();
    same.push_back(CompareCameras(cameras[c], cameras[c], {1}));
  }
  const ExtrinsicsDifference mount = CompareExtrinsics(
      {cameras[0], cameras[0], same[0]}, {cameras[1], cameras[1], same[1]}, {}, {});
  EXPECT_FALSE(mount.has_prediction);
  EXPECT_FALSE(mount.differs);
  EXPECT_LT(mount.rotation, 1e-12);
}

TEST(CompareExtrinsics, DifferencesAreAsLargeAsTheSigmasOfBothPredict) {
  // Of two cameras of which neither is the one that others stand relative to in the files.
  constexpr int kPairs = 16;
  const std::vector<double> distances{1, std::numeric_limits<double>::infinity()};
  double squares = 0, turn = 0, shift = 0;
  for (unsigned pair = 0; pair < kPairs; ++pair) {
    const SyntheticProblem problem = MakeProblem(3 + pair / 8, {.cameras = 3, .frames = 10});
    const Calibration a = Calibrate(WithNoise(problem.input, kNoise, 100 + pair), {});
    const Calibration b = Calibrate(WithNoise(problem.input, kNoise, 200 + pair), {});
    std::vector<CalibratedCamera> of_a, of_b;
    std::vector<CameraDifference> differences;
    for (const size_t c : {1, 2}) {
      of_a.push_back(DescribeCamera(a, c));
      of_b.push_back(DescribeCamera(b, c));
      differences.push_back(CompareCameras(of_a.back(), of_b.back(), distances));
    }
    const ExtrinsicsDifference mount = CompareExtrinsics({of_a[0], of_b[0], differences[0]},
                                                         {of_a[1], of_b[1], differences[1]},
                                                         DescribeCorrelations(a),
                                                         DescribeCorrelations(b));
    ASSERT_TRUE(mount.has_prediction);
    squares += ChiSquareQuantile(6, mount.probability);
    turn += std::pow(mount.rotation / mount.rotation_sigma, 2);
    shift += std::pow(mount.translation / mount.translation_sigma, 2);
  }
  // Chi-square of six numbers a pair; the others have hardly more than one that counts.
  constexpr double kChance = 1e-4;
  EXPECT_GT(squares, ChiSquareQuantile(6 * kPairs, 1 - kChance));
  EXPECT_LT(squares, ChiSquareQuantile(6 * kPairs, kChance));
  for (const double sum : {turn, shift}) {
    EXPECT_GT(sum, ChiSquareQuantile(kPairs, 1 - kChance));
    EXPECT_LT(sum, ChiSquareQuantile(kPairs, kChance));
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
