// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/merge.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "calib/base/error.h"
#include "calib/base/names.h"
#include "models/registry.h"
#include "tests/calib/random.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

// Calibrations of a rig of three cameras with errors of a random, full covariance.
class MergeTest : public ::testing::Test {
 protected:
  MergeTest() {
    const CameraModel* const model = FindModel(CameraModels(), "pinhole-radial3");
    Vector6d xi = Vector6d::Zero();
    for (const char* name : {"left", "right", "top"}) {
      CalibratedCamera& camera = truth_.cameras.emplace_back();
      camera.name = name;
      camera.model = model;
      camera.image_size = {640, 480};
      camera.params = {500, 502, 320, 240, -0.2, 0.05, 0.01};
      camera.T_camera_rig = Exp(xi);
      xi += (Vector6d() << -0.1, 0.02, 0.01, 0.1, 0.3, -0.2).finished();
    }
  }

  // An estimate of the cameras of these names; the first is its rig.
  CalibrationRecord Estimate(const std::vector<std::string>& names, Random* random) const {
    CalibrationRecord record;
    record.path = "of_" + names[0] + ".yaml";
    std::vector<double> sigma;
    const RigidTransform T_rig_first = FindCamera(truth_, names[0]).T_camera_rig.Inverse();
    for (const std::string& name : names) {
      CalibratedCamera& camera = record.cameras.emplace_back(FindCamera(truth_, name));
      camera.T_camera_rig = camera.T_camera_rig * T_rig_first;
      for (size_t k = 0; k < camera.params.size(); ++k) {
        record.correlations.names.push_back(name + "." + std::string(camera.model->params[k].name));
        sigma.push_back(random->Uniform(0.5, 2) * (k < 4 ? 0.2 : 1e-3));
      }
      for (const char* component : kExtrinsicsNames) {
        if (&camera == record.cameras.data()) break;
        record.correlations.names.push_back(name + ".T_camera_rig." + component);
        sigma.push_back(random->Uniform(0.5, 2) * 1e-4);
      }
    }
    const auto count = static_cast<Eigen::Index>(sigma.size());
    // More columns than rows: no direction is known without error.
    Eigen::MatrixXd root(count, 2 * count);
    for (double& entry : root.reshaped()) entry = random->Gaussian(1);
    root = (root.rowwise().norm().cwiseInverse().asDiagonal() * root).eval();
    record.correlations.matrix = root * root.transpose();
    Eigen::VectorXd errors(2 * count);
    for (double& error : errors) error = random->Gaussian(1);
    errors = (root * errors).eval();
    Eigen::Index next = 0;
    for (CalibratedCamera& camera : record.cameras) {
      std::vector<double> sigma_params;
      const auto own = static_cast<Eigen::Index>(camera.params.size());
      for (double& param : camera.params) {
        sigma_params.push_back(sigma[static_cast<size_t>(next)]);
        param += sigma_params.back() * errors[next++];
      }
      camera.covariance = CovarianceOf(
          sigma_params, record.correlations.matrix.block(next - own, next - own, own, own));
      if (&camera == record.cameras.data()) continue;
      Vector6d xi = Log(camera.T_camera_rig);
      for (double& component : xi) {
        const double of = sigma[static_cast<size_t>(next)];
        camera.sigma_xi[&component - xi.data()] = of;
        component += of * errors[next++];
      }
      camera.T_camera_rig = Exp(xi);
    }
    return record;
  }

  CalibrationRecord truth_;
};

TEST_F(MergeTest, ErrorsAreAsLargeAsTheStandardErrors) {
  constexpr int kSeeds = 150;
  double squares = 0, chi_square = 0;
  int count = 0, degrees = 0, disagree = 0;
  for (unsigned seed = 1; seed <= kSeeds; ++seed) {
    Random random(seed);
    // The third and fourth have no camera of the first as their rig's frame.
    const std::vector<CalibrationRecord> parts{Estimate({"left", "right"}, &random),
                                               Estimate({"left"}, &random),
                                               Estimate({"top", "right"}, &random),
                                               Estimate({"right", "top", "left"}, &random)};
    const MergedCalibrations merged = MergeCalibrations(parts, {});
    ASSERT_EQ(merged.record.cameras.size(), 3U);
    disagree += merged.scale > 1 ? 1 : 0;
    chi_square += merged.chi_square;
    degrees += merged.degrees;
    for (size_t c = 0; c < 3; ++c) {
      const CalibratedCamera& camera = merged.record.cameras[c];
      const CalibratedCamera& truth = truth_.cameras[c];
      for (size_t k = 0; k < camera.params.size(); ++k, ++count) {
        const double error = (camera.params[k] - truth.params[k]) / camera.Sigma(k);
        squares += error * error;
      }
      const Vector6d error = Log(camera.T_camera_rig) - Log(truth.T_camera_rig);
      for (Eigen::Index i = 0; c > 0 && i < 6; ++i, ++count) {
        squares += error[i] * error[i] / (camera.sigma_xi[i] * camera.sigma_xi[i]);
      }
    }
    // The least standard error that any part has is larger.
    EXPECT_LT(merged.record.cameras[0].Sigma(0), parts[0].cameras[0].Sigma(0));
  }
  EXPECT_NEAR(squares / count, 1, 0.06);
  EXPECT_NEAR(chi_square / degrees, 1, 0.05);
  EXPECT_LE(disagree, 2);
}

TEST_F(MergeTest, OfOneCalibrationIsThatCalibration) {
  Random random(1);
  const std::vector<CalibrationRecord> parts{Estimate({"left", "right", "top"}, &random)};
  const CalibrationRecord merged = MergeCalibrations(parts, {}).record;
  const Eigen::MatrixXd &found = merged.correlations.matrix, &given = parts[0].correlations.matrix;
  EXPECT_EQ(merged.correlations.names, parts[0].correlations.names);
  EXPECT_LT((found - given).norm(), 1e-6);
  EXPECT_LT((merged.cameras[2].sigma_xi - parts[0].cameras[2].sigma_xi).norm(), 1e-9);
}

TEST_F(MergeTest, ScalesStandardErrorsOfCalibrationsThatDisagree) {
  Random random(2);
  std::vector<CalibrationRecord> parts;
  for (int i = 0; i < 3; ++i) parts.push_back(Estimate({"left", "right"}, &random));
  const MergedCalibrations agreeing = MergeCalibrations(parts, {});
  EXPECT_EQ(agreeing.scale, 1);
  parts[1].cameras[0].params[0] += 5;  // refocused
  const MergedCalibrations merged = MergeCalibrations(parts, {});
  EXPECT_GT(merged.scale, 1.5);
  EXPECT_NEAR(merged.scale * merged.scale, merged.chi_square / merged.degrees, 1e-9);
  for (size_t c = 0; c < 2; ++c) {
    const CalibratedCamera &scaled = merged.record.cameras[c], &plain = agreeing.record.cameras[c];
    for (size_t k = 0; k < plain.params.size(); ++k) {
      EXPECT_NEAR(scaled.Sigma(k) / plain.Sigma(k), merged.scale, 1e-6) << c << " " << k;
    }
  }
  const std::vector<Finding> findings = FindingsOfMerge(merged, parts, {});
  ASSERT_FALSE(findings.empty());
  EXPECT_EQ(findings[0].code, "calibrations_disagree");
  EXPECT_THAT(findings[0].what, HasSubstr("left.f_x"));
}

TEST_F(MergeTest, AParameterThatOneLeavesOpenIsThatOfTheOther) {
  Random random(3);
  std::vector<CalibrationRecord> parts{Estimate({"left"}, &random), Estimate({"left"}, &random)};
  parts[0].cameras[0].covariance.row(5).setZero();
  parts[0].cameras[0].covariance.col(5).setZero();
  parts[0].cameras[0].covariance(5, 5) = std::numeric_limits<double>::infinity();
  const CalibrationRecord merged = MergeCalibrations(parts, {}).record;
  EXPECT_LE(merged.cameras[0].Sigma(5), parts[1].cameras[0].Sigma(5));
  EXPECT_GT(merged.cameras[0].Sigma(5), 0);
}

TEST_F(MergeTest, RefusesWhatCannotBeMerged) {
  Random random(4);
  const auto expect = [&](std::vector<CalibrationRecord> parts, const std::string& words) {
    try {
      (void)MergeCalibrations(parts, {});
      FAIL() << words;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr(words));
    }
  };
  expect({Estimate({"left", "right"}, &random), Estimate({"top"}, &random)},
         "of_top.yaml: nothing in the calibrations places top with respect to left");
  CalibrationRecord other = Estimate({"left"}, &random);
  other.cameras[0].image_size = {320, 240};
  expect({Estimate({"left"}, &random), other}, "left has 320 x 240 pixels");
  other = Estimate({"left"}, &random);
  other.cameras[0].model = FindModel(CameraModels(), "pinhole-radtan");
  expect({Estimate({"left"}, &random), other}, "left has model pinhole-radtan");
  other = Estimate({"left"}, &random);
  other.cameras[0].covariance.row(6).setZero();
  other.cameras[0].covariance.col(6).setZero();
  expect({Estimate({"left"}, &random), other}, "left.A_2 is fixed at");
  other.cameras[0].covariance.setZero();
  expect({Estimate({"left"}, &random), other}, "no standard errors");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
