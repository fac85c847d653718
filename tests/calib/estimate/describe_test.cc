// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/describe.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

const Calibration& Pair() {
  static const Calibration calibration =
      Calibrate(MakeProblem(11, {.cameras = 2, .frames = 8, .noise = 0.1}).input, {});
  return calibration;
}

// d Log(T) / d (the chart in which T was estimated).
Matrix6d NumericLogJacobian(const RigidTransform& T) {
  constexpr double kStep = 1e-6;
  Matrix6d J;
  for (int i = 0; i < 6; ++i) {
    const Vector6d step = kStep * Vector6d::Unit(i);
    J.col(i) = (Log(Retract(T, step)) - Log(Retract(T, -step))) / (2 * kStep);
  }
  return J;
}

TEST(Describe, HasTheCovarianceOfSe3Vectors) {
  const CalibrationRecord record = Describe(Pair());
  const Uncertainty& uncertainty = Pair().uncertainty;
  const int place = uncertainty.extrinsics_index[1];
  ASSERT_GE(place, 0);
  EXPECT_TRUE(record.cameras[0].sigma_xi.isZero(0)) << "the rig's frame";
  const Eigen::Index size = uncertainty.covariance.rows();
  Eigen::MatrixXd J = Eigen::MatrixXd::Identity(size, size);
  J.block<6, 6>(place, place) = NumericLogJacobian(Pair().bundle.cameras[1].T_camera_rig);
  const Eigen::MatrixXd C = J * uncertainty.covariance * J.transpose();
  const Eigen::VectorXd sigma = C.diagonal().cwiseSqrt();
  for (Eigen::Index i = 0; i < 6; ++i) {
    EXPECT_NEAR(record.cameras[1].sigma_xi[i] / sigma[place + i], 1, 1e-6);
  }
  EXPECT_EQ(record.correlations.names, uncertainty.names);
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j < size; ++j) {
      EXPECT_NEAR(record.correlations.matrix(i, j), C(i, j) / (sigma[i] * sigma[j]), 1e-6);
    }
  }
}

TEST(Describe, HasInfiniteSigmasAlongOpenDirections) {
  Calibration calibration = Pair();
  const int place = calibration.uncertainty.extrinsics_index[1];
  // The right camera's translation along y.
  Eigen::VectorXd direction = Eigen::VectorXd::Zero(calibration.uncertainty.covariance.rows());
  direction[place + 1] = 0.5;
  calibration.uncertainty.undetermined = direction;
  const Vector6d part =
      NumericLogJacobian(calibration.bundle.cameras[1].T_camera_rig).col(1).cwiseAbs();
  const Vector6d before = Describe(Pair()).cameras[1].sigma_xi,
                 sigma = Describe(calibration).cameras[1].sigma_xi;
  int open = 0;
  for (Eigen::Index i = 0; i < 6; ++i) {
    if (part[i] > 1e-4) {
      EXPECT_TRUE(std::isinf(sigma[i])) << i;
      ++open;
    } else if (part[i] < 1e-7) {
      EXPECT_EQ(sigma[i], before[i]) << i;
    }
  }
  EXPECT_GE(open, 1);
  EXPECT_LE(open, 3) << "a translation opens no rotation";
}

TEST(Describe, HasEachObservationWithItsResidual) {
  Calibration calibration = Pair();
  calibration.bundle.observations[3].used = false;
  const CalibrationRecord record = Describe(calibration);
  size_t count = 0;
  for (size_t c = 0; c < 2; ++c) {
    const CalibratedCamera& camera = record.cameras[c];
    EXPECT_EQ(camera.params, calibration.bundle.cameras[c].params);
    for (const ResidualRow& row : camera.residuals) {
      const RigidTransform T = record.CameraFromTarget(c, row.frame);
      const Eigen::Vector3d p = T * record.markers.at(row.marker).position;
      std::array<double, 2> predicted{};
      ASSERT_TRUE(camera.model->Project(
          camera.params.data(), camera.config.data(), row.values.data(), p, predicted.data()));
      for (size_t i = 0; i < 2; ++i) {
        EXPECT_NEAR(row.residual[i], row.values[i] - predicted[i], 2e-5) << "five decimals";
        EXPECT_EQ(std::round(row.values[i] * 1e5) / 1e5, row.values[i]);
      }
      EXPECT_GT(row.noise_sigma, 0.05);
      count += row.used ? 1 : 0;
    }
    EXPECT_EQ(camera.view_poses.size(), 8U);
    for (const auto& [frame, view] : camera.view_poses) {
      EXPECT_FALSE(view.misplaced);
      EXPECT_LT(
          (view.T_target_rig.t - record.frames[static_cast<size_t>(frame)].T_target_rig.t).norm(),
          1e-12);
    }
  }
  EXPECT_EQ(count,
            static_cast<size_t>(std::ranges::count_if(calibration.bundle.observations,
                                                      [](const auto& each) { return each.used; })));
  EXPECT_TRUE(record.adjustment->converged);
  EXPECT_EQ(record.frames.size(), 8U);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
