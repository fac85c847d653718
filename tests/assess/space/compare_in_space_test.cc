// SPDX-License-Identifier: Apache-2.0
//
// Two calibrations of one rig in space: errors as large as stated are no difference, a turned
// camera is one.
#include "assess/space/compare_in_space.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>

#include "calib/base/error.h"
#include "calib/space/space_rig.h"
#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal {
namespace TEST_FILE {

CalibrationRecord UncertainPair() {
  CalibrationRecord record;
  for (const char* name : {"left", "right"}) {
    CalibratedCamera& camera = record.cameras.emplace_back();
    camera.name = name;
    camera.model = FindModel(CameraModels(), "pinhole");
    camera.image_size = {640, 480};
    camera.params = {800, 801, 318, 241};
    camera.covariance = Eigen::Vector4d(0.04, 0.04, 4e-4, 4e-4).asDiagonal();
    camera.covariance(0, 1) = camera.covariance(1, 0) = 0.036;
    camera.fit.noise_sigma = 0.1;
  }
  CalibratedCamera& right = record.cameras[1];
  right.T_camera_rig.t = {-0.2, 0.001, 0.002};
  right.sigma_xi << 4e-5, 4e-5, 6e-5, 1e-4, 1e-4, 5e-5;
  return record;
}

// The true rig with an error as large as stated, and one of the right camera's turn about y.
CalibrationRecord Drawn(const CalibrationRecord& truth, double turn, testing::Random* random) {
  const SpaceRig rig = MakeSpaceRig(truth, {});
  Eigen::VectorXd z(rig.Size());
  for (double& each : z) each = random->Gaussians<1>(1)[0];
  const Eigen::VectorXd theta = rig.root * z;
  CalibrationRecord drawn = truth;
  std::vector<Vector6d> charts(truth.cameras.size(), Vector6d::Zero());
  charts[1][4] = turn;
  for (size_t i = 0; i < rig.unknowns.size(); ++i) {
    const auto& unknown = rig.unknowns[i];
    const double error = theta[static_cast<Eigen::Index>(i)];
    if (unknown.param) {
      drawn.cameras[unknown.camera].params[*unknown.param] += error;
    } else {
      charts[unknown.camera][unknown.component] += error;
    }
  }
  for (size_t c = 0; c < charts.size(); ++c) {
    drawn.cameras[c].T_camera_rig = Retract(drawn.cameras[c].T_camera_rig, charts[c]);
  }
  return drawn;
}

TEST(CompareInSpace, ErrorsAsStatedAreNoDifferenceAndATurnedCameraIsOne) {
  constexpr int kRigs = 100;
  const CalibrationRecord truth = UncertainPair();
  testing::Random random(1);
  int false_alarms = 0, found = 0;
  double ratio = 0;
  for (int i = 0; i < kRigs; ++i) {
    const CalibrationRecord a = Drawn(truth, 0, &random), b = Drawn(truth, 0, &random),
                            turned = Drawn(truth, 6e-4, &random);
    const SpaceComparison same = CompareInSpace(a, b, {}, {0.5, 2}, 0.1);
    ASSERT_TRUE(same.has_prediction);
    ASSERT_EQ(same.differences.size(), 6U);
    false_alarms += !same.same;
    for (const SpaceDifference& each : same.differences) {
      ratio += std::pow(each.rms / each.predicted, 2) / (6.0 * kRigs);
    }
    found += !CompareInSpace(a, turned, {}, {0.5, 2}, 0.1).same;
  }
  std::cout << false_alarms << " false alarms of " << kRigs << ", " << found
            << " found; squared ratio of found to predicted " << ratio << "\n";
  // One in a hundred; more than 5 have a probability of 0.1 %.
  EXPECT_LE(false_alarms, 5);
  EXPECT_NEAR(ratio, 1, 0.25);
  // 6e-4 rad are four standard errors of the difference of two.
  EXPECT_GE(found, kRigs / 2);
}

TEST(CompareInSpace, AScaleOfSpaceIsADifferenceOfLengthsAMotionIsNone) {
  CalibrationRecord a = UncertainPair(), longer = a;
  longer.cameras[1].T_camera_rig.t *= 1.01;
  const SpaceComparison scaled = CompareInSpace(a, longer, {}, {1}, 0.1);
  EXPECT_EQ(scaled.differences[2].quantity, "bar");
  EXPECT_NEAR(scaled.differences[2].rms, 0.001, 2e-5);
  EXPECT_TRUE(scaled.differences[2].differs);
  // Both cameras turned alike: the same rig, whose frame has moved.
  const RigidTransform T = Exp((Vector6d() << 0.01, 0, 0, 0, 1e-3, 2e-3).finished());
  CalibrationRecord moved = a;
  moved.cameras[1].T_camera_rig = moved.cameras[1].T_camera_rig * T;
  moved.cameras[0].T_camera_rig = T;
  for (const SpaceDifference& each : CompareInSpace(a, moved, {}, {1}, 0.1).differences) {
    EXPECT_LT(each.rms, 1e-9) << each.quantity;
  }
}

// A wrong disparity moves points along z most: at 1 m before a base of 0.2 m five times as far as
// aside.
TEST(CompareInSpace, LateralDifferencesAreThoseOfXAndYAlone) {
  CalibrationRecord a = UncertainPair();
  for (CalibratedCamera& camera : a.cameras) {
    camera.model = FindModel(CameraModels(), "pinhole-radial3");
    camera.params.insert(camera.params.end(), {0, 0, 0});
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(7, 7);
    covariance.topLeftCorner(4, 4) = camera.covariance;
    camera.covariance = covariance;
  }
  CalibrationRecord bent = a;
  bent.cameras[1].params[4] = 0.01;  // A_0
  const SpaceComparison compared = CompareInSpace(a, bent, {}, {1}, 0.1);
  std::map<std::string, double> rms;
  for (const SpaceDifference& each : compared.differences) rms[each.quantity] = each.rms;
  EXPECT_GT(rms.at("lateral"), 0);
  EXPECT_LT(rms.at("lateral"), 0.6 * rms.at("z"));
}

// Half of the rays of the second calibration meet nowhere.
TEST(CompareInSpace, LeavesOutWhatOneOfThemDoesNotMeasure) {
  const CalibrationRecord a = UncertainPair();
  CalibrationRecord b = a;
  b.cameras[0].params[0] = 1e-3;
  const SpaceComparison all = CompareInSpace(a, a, {}, {0.5}, 0.1);
  const SpaceComparison few = CompareInSpace(a, b, {}, {0.5}, 0.1);
  ASSERT_EQ(few.differences[0].quantity, "z");
  EXPECT_LT(few.differences[0].points, all.differences[0].points);
  EXPECT_TRUE(std::isfinite(few.differences[0].rms));
}

TEST(CompareInSpace, RefusesCalibrationsWithoutCommonCameras) {
  CalibrationRecord a = UncertainPair(), b = a;
  b.cameras[1].name = "other";
  EXPECT_THROW(CompareInSpace(a, b, {}, {1}, 0.1), Error);
}

}  // namespace TEST_FILE
}  // namespace plenocal
