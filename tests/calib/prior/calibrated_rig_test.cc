// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/calibrated_rig.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "calib/base/error.h"
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

// Two calibrated cameras with sizes of common displacements; the second parameter is fixed, the
// first of the second camera open.
CalibrationRecord PairWithNuisances() {
  CalibrationRecord record = UncertainPair();
  record.cameras[0].sigma_xi.setZero();
  double next = 0;
  for (CalibratedCamera& camera : record.cameras) {
    camera.image_size = {640, 480};
    for (double& param : camera.params) param = next += 1;
    for (Eigen::Index k = 0; k < camera.covariance.rows(); ++k) {
      camera.covariance(k, k) = k == 1 ? 0 : 0.01 * (1 + static_cast<double>(k));
    }
    camera.nuisances = {{.value = next += 1, .sigma = 0.5}, {.value = next += 1, .sigma = 0.25}};
  }
  record.cameras[1].covariance(0, 0) = std::numeric_limits<double>::infinity();
  record.correlations.names = {"left.shared_2", "right.shared_1", "left.f_x"};
  record.correlations.matrix.resize(3, 3);
  record.correlations.matrix << 1, 0.3, 0.2, 0.3, 1, 0.1, 0.2, 0.1, 1;
  return record;
}

TEST(CalibratedRig, HasSizesOfCommonDisplacementsAsUnknowns) {
  const CalibrationRecord record = PairWithNuisances();
  const CalibratedRig rig = MakeCalibratedRig(record, {}, true);
  const size_t count = record.cameras[0].params.size();
  ASSERT_TRUE(rig.prior);
  // Per camera its parameters, extrinsics of the second; then the sizes.
  std::vector<std::pair<size_t, size_t>> expected;
  for (size_t k = 0; k < count; ++k) {
    if (k != 1) expected.emplace_back(0, k);
  }
  for (size_t k = 2; k < count; ++k) expected.emplace_back(1, k);
  for (size_t k = 0; k < 6; ++k) expected.emplace_back(1, 100 + k);
  for (const size_t c : {0, 1}) {
    for (size_t k = 0; k < 2; ++k) expected.emplace_back(c, count + k);
  }
  std::vector<std::pair<size_t, size_t>> found;
  for (const CalibrationPrior::Unknown& unknown : rig.prior->unknowns) {
    found.emplace_back(unknown.camera,
                       unknown.param.value_or(100 + static_cast<size_t>(unknown.component)));
    if (!unknown.param) continue;
    EXPECT_EQ(unknown.value, rig.cameras[unknown.camera].params[*unknown.param]);
  }
  EXPECT_EQ(found, expected);
  for (size_t c = 0; c < 2; ++c) {
    const BundleCamera& camera = rig.cameras[c];
    const CalibratedCamera& of = record.cameras[c];
    EXPECT_EQ(camera.name, of.name);
    EXPECT_EQ(camera.image_size, of.image_size);
    std::vector<double> params = of.params;
    std::vector<bool> fixed(count, false);
    fixed[1] = true, fixed[0] = c == 1;
    for (const EstimatedNumber& nuisance : of.nuisances) {
      params.push_back(nuisance.value);
      fixed.push_back(false);
    }
    EXPECT_EQ(camera.params, params);
    EXPECT_EQ(camera.fixed, fixed);
    EXPECT_EQ(camera.nuisances.size(), 2U);
    EXPECT_EQ(camera.ModelParams(), count);
  }
  const Eigen::MatrixXd covariance = (rig.prior->weight.transpose() * rig.prior->weight).inverse();
  const Eigen::Index last = covariance.rows() - 1;
  EXPECT_NEAR(covariance(last - 3, last - 3), 0.25, 1e-9);
  EXPECT_NEAR(covariance(last, last), 0.0625, 1e-9);
  EXPECT_NEAR(covariance(last - 2, last - 1), 0.3 * 0.25 * 0.5, 1e-9);
  EXPECT_NEAR(covariance(0, last - 2), 0.2 * 0.1 * 0.25, 1e-9);
  EXPECT_NEAR(covariance(0, 0), 0.01, 1e-9);
  EXPECT_NEAR(covariance(1, 1), 0.03, 1e-9);
}

TEST(CalibratedRig, LeavesOutSizesOfCommonDisplacements) {
  CalibrationRecord record = PairWithNuisances();
  const CalibratedRig with = MakeCalibratedRig(record, {}, true);
  const CalibratedRig rig = MakeCalibratedRig(record, {});
  const Eigen::Index count = std::ssize(with.prior->unknowns) - 4;
  ASSERT_EQ(std::ssize(rig.prior->unknowns), count);
  EXPECT_EQ(rig.cameras[0].params, record.cameras[0].params);
  EXPECT_EQ(rig.cameras[0].nuisances.size(), 0U);
  const auto covariance = [](const CalibratedRig& of) -> Eigen::MatrixXd {
    return (of.prior->weight.transpose() * of.prior->weight).inverse();
  };
  // The marginal prior.
  EXPECT_LT((covariance(rig) - covariance(with).topLeftCorner(count, count)).norm(), 1e-9);
  // Where the first parameter is open.
  std::swap(record.cameras[0], record.cameras[1]);
  const CalibratedRig swapped = MakeCalibratedRig(record, {});
  EXPECT_TRUE(swapped.prior->weight.allFinite());
  EXPECT_EQ(swapped.prior->unknowns[0].param, 2U);
}

TEST(CalibratedRig, IsOfTheNamedCamerasInTheirOrder) {
  const CalibrationRecord record = PairWithNuisances();
  const std::vector<std::string> names{"right", "left"};
  const CalibratedRig rig = MakeCalibratedRig(record, names);
  ASSERT_EQ(rig.cameras.size(), 2U);
  EXPECT_EQ(rig.cameras[0].name, "right");
  EXPECT_TRUE(rig.cameras[0].is_master);
  // Of two extrinsics one is known without error: their difference is not.
  EXPECT_FALSE(rig.cameras[1].is_master);
  const RigidTransform expected =
      record.cameras[0].T_camera_rig * record.cameras[1].T_camera_rig.Inverse();
  EXPECT_LT(LocalCoordinates(expected, rig.cameras[1].T_camera_rig).norm(), 1e-12);
  EXPECT_LT(LocalCoordinates(expected, rig.prior->T_camera_rig[1]).norm(), 1e-12);
  EXPECT_LT(Log(rig.cameras[0].T_camera_rig).norm(), 1e-12);
  const std::vector<std::string> one{"left"};
  const CalibratedRig left = MakeCalibratedRig(record, one);
  ASSERT_EQ(left.cameras.size(), 1U);
  EXPECT_EQ(left.prior->unknowns.size(), record.cameras[0].params.size() - 1);
  EXPECT_THROW((void)MakeCalibratedRig(record, std::vector<std::string>{"top"}), Error);
}

// Each component needs a standard error.
TEST(CalibratedRig, TakesExtrinsicsWithoutAllStandardErrorsAsGiven) {
  const double kInfinity = std::numeric_limits<double>::infinity();
  for (const double sigma : {0.0, kInfinity}) {
    CalibrationRecord record = PairWithNuisances();
    record.cameras[1].sigma_xi[4] = sigma;
    const CalibratedRig rig = MakeCalibratedRig(record, {});
    EXPECT_TRUE(rig.cameras[1].is_master);
    EXPECT_EQ(rig.prior->unknowns.size(), 2 * record.cameras[0].params.size() - 3);
    EXPECT_TRUE(rig.prior->weight.allFinite());
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
