// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/calibrated_rig.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "models/registry.h"

namespace plenocal {
namespace TEST_FILE {

// Extrinsics of both cameras are uncertain: the rig's master is a third.
CalibrationRecord UncertainPair() {
  CalibrationRecord record;
  const CameraModel* const model = FindModel(CameraModels(), "pinhole-radial3");
  Vector6d xi;
  xi << -0.1, 0.02, 0.03, 0.2, -0.3, 0.1;
  for (const char* name : {"left", "right"}) {
    CalibratedCamera& camera = record.cameras.emplace_back();
    camera.name = name;
    camera.model = model;
    camera.params.assign(model->params.size(), 1);
    const auto count = static_cast<Eigen::Index>(camera.params.size());
    camera.covariance = Eigen::MatrixXd::Zero(count, count);
    camera.T_camera_rig = Exp(xi);
    camera.sigma_xi << 2e-5, 3e-5, 1e-5, 5e-5, 4e-5, 7e-5;
    xi = -2 * xi;
  }
  return record;
}

// Derivatives of the chart of T_right_left by both se(3) vectors, right first, by differences.
Eigen::Matrix<double, 6, 12> Derivatives(const CalibrationRecord& record) {
  const auto relative = [&](const Eigen::Matrix<double, 12, 1>& change) {
    const Vector6d right = Log(record.cameras[1].T_camera_rig) + change.head<6>();
    const Vector6d left = Log(record.cameras[0].T_camera_rig) + change.tail<6>();
    return Exp(right) * Exp(left).Inverse();
  };
  const RigidTransform at = relative(Eigen::Matrix<double, 12, 1>::Zero());
  const auto chart = [&](const RigidTransform& T) {
    Vector6d delta;
    delta << T.t - at.t, LogRotation(T.R * at.R.transpose());
    return delta;
  };
  constexpr double kStep = 1e-6;
  Eigen::Matrix<double, 6, 12> J;
  for (int i = 0; i < 12; ++i) {
    const Eigen::Matrix<double, 12, 1> step = kStep * Eigen::Matrix<double, 12, 1>::Unit(i);
    J.col(i) = (chart(relative(step)) - chart(relative(-step))) / (2 * kStep);
  }
  return J;
}

TEST(CalibratedRig, CarriesTheCovarianceOfExtrinsicsToTheFirstCamera) {
  const CalibrationRecord record = UncertainPair();
  const CalibratedRig rig = MakeCalibratedRig(record, {});
  ASSERT_TRUE(rig.prior);
  ASSERT_EQ(rig.prior->unknowns.size(), 6U);
  EXPECT_TRUE(rig.cameras[0].is_master);
  EXPECT_FALSE(rig.cameras[1].is_master);

  Eigen::Matrix<double, 12, 1> sigma;
  sigma << record.cameras[1].sigma_xi, record.cameras[0].sigma_xi;
  const Eigen::Matrix<double, 6, 12> root = Derivatives(record) * sigma.asDiagonal();
  const Matrix6d expected = root * root.transpose();
  const Matrix6d found = (rig.prior->weight.transpose() * rig.prior->weight).inverse();
  EXPECT_LT((found - expected).norm(), 1e-6 * expected.norm());
}

TEST(CalibratedRig, HasNoPriorWithoutStandardErrors) {
  CalibrationRecord record = UncertainPair();
  for (CalibratedCamera& camera : record.cameras) camera.sigma_xi.setZero();
  const CalibratedRig rig = MakeCalibratedRig(record, {});
  EXPECT_FALSE(rig.prior);
  EXPECT_TRUE(rig.cameras[1].is_master);  // its extrinsics are given
}

}  // namespace TEST_FILE
}  // namespace plenocal
