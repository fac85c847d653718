// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/merge.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "calib/base/names.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
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
  for (size_t c = 0; c < 3; ++c) {
    const Eigen::MatrixXd &own = merged.cameras[c].covariance, &of = parts[0].cameras[c].covariance;
    EXPECT_LT((own - of).norm(), 1e-6 * of.norm()) << c;
    // Also of the small ones.
    EXPECT_NEAR(own(4, 6) / of(4, 6), 1, 1e-4) << c;
  }
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
    EXPECT_THAT(RefusalOf([&] { (void)MergeCalibrations(parts, {}); }), HasSubstr(words));
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

// Calibrations whose merge can be computed by hand: pinholes with uncorrelated errors.
struct PlainCamera {
  std::string name;
  std::vector<double> params{500, 400, 320, 240}, sigmas{0, 0, 0, 0};
  double x = 0, sigma_x = 0;  ///< of the extrinsics, m; other components are as exact
};

CalibrationRecord Plain(const std::string& path, const std::vector<PlainCamera>& cameras) {
  CalibrationRecord record;
  record.path = path;
  for (const PlainCamera& plain : cameras) {
    CalibratedCamera& camera = record.cameras.emplace_back();
    camera.name = plain.name;
    camera.model = FindModel(CameraModels(), "pinhole");
    camera.image_size = {640, 480};
    camera.params = plain.params;
    const Eigen::Map<const Eigen::VectorXd> sigmas(plain.sigmas.data(), 4);
    camera.covariance = sigmas.cwiseAbs2().asDiagonal();
    camera.T_camera_rig.t.x() = plain.x;
    if (plain.sigma_x > 0)
      camera.sigma_xi << Eigen::Vector3d::Constant(plain.sigma_x),
          Eigen::Vector3d::Constant(1e-3 * plain.sigma_x);
  }
  return record;
}

std::string ErrorOfMerge(const std::vector<CalibrationRecord>& parts,
                         const MergeOptions& options = {}) {
  return RefusalOf([&] { (void)MergeCalibrations(parts, options); });
}

// f_x, f_y and c_x are estimated, c_y is fixed.
std::vector<CalibrationRecord> TwoOfOneCamera(double f_x = 503) {
  std::vector<CalibrationRecord> parts{
      Plain("a.yaml", {{.name = "left", .params = {500, 400, 320, 240}, .sigmas = {1, 2, 0.5, 0}}}),
      Plain("b.yaml",
            {{.name = "left", .params = {f_x, 404, 321, 240}, .sigmas = {2, 1, 0.5, 0}}})};
  const auto set_fit = [](CameraFit* fit, int points, int rejected, int views, double rms) {
    fit->points = points, fit->rejected = rejected, fit->views = views;
    fit->rms = rms, fit->noise_sigma = rms - 0.1;
  };
  set_fit(&parts[0].cameras[0].fit, 100, 3, 10, 0.2);
  set_fit(&parts[1].cameras[0].fit, 300, 5, 20, 0.4);
  return parts;
}

TEST(Merge, IsTheWeightedMeanOfTwo) {
  const MergedCalibrations merged = MergeCalibrations(TwoOfOneCamera(), {});
  ASSERT_EQ(merged.record.cameras.size(), 1U);
  const CalibratedCamera& left = merged.record.cameras[0];
  const std::vector<double> params{500 + 3.0 / 5, 400 + 4 * 4.0 / 5, 320.5, 240};
  const Eigen::Vector4d variances(0.8, 0.8, 0.125, 0);
  for (size_t k = 0; k < 4; ++k) EXPECT_NEAR(left.params[k], params[k], 1e-9) << k;
  EXPECT_LT((left.covariance - Eigen::Matrix4d(variances.asDiagonal())).norm(), 1e-9);
  EXPECT_EQ(left.name, "left");
  EXPECT_EQ(left.image_size, (ImageSize{640, 480}));
  EXPECT_EQ(left.sigma_xi, Vector6d(Vector6d::Zero()));
  EXPECT_THAT(merged.record.correlations.names, ElementsAre("left.f_x", "left.f_y", "left.c_x"));
  EXPECT_LT((merged.record.correlations.matrix - Eigen::Matrix3d::Identity()).norm(), 1e-9);
  EXPECT_TRUE(merged.record.adjustment.value().converged);
  EXPECT_TRUE(merged.mounts.empty());

  EXPECT_EQ(left.fit.points, 400);
  EXPECT_EQ(left.fit.rejected, 8);
  EXPECT_EQ(left.fit.views, 30);
  EXPECT_NEAR(left.fit.rms, std::sqrt(0.25 * 0.04 + 0.75 * 0.16), 1e-12);
  EXPECT_NEAR(left.fit.noise_sigma, std::sqrt(0.25 * 0.01 + 0.75 * 0.09), 1e-12);

  EXPECT_NEAR(merged.chi_square, 9.0 / 5 + 16.0 / 5 + 1 / 0.5, 1e-9);
  EXPECT_EQ(merged.degrees, 3);
  EXPECT_EQ(merged.scale, 1);
  ASSERT_EQ(merged.deviations.size(), 6U);
  const double deviations[]{-0.6, -3.2, -0.5, 2.4, 0.8, 0.5};
  const double own[]{1, 4, 0.25, 4, 1, 0.25};
  for (size_t i = 0; i < 6; ++i) {
    const MergeDeviation& each = merged.deviations[i];
    EXPECT_EQ(each.calibration, i / 3);
    EXPECT_EQ(each.camera, 0U);
    EXPECT_EQ(each.master, 0U);
    EXPECT_EQ(each.param, i % 3);
    EXPECT_NEAR(each.deviation, deviations[i], 1e-9);
    EXPECT_NEAR(each.sigma, std::sqrt(own[i] - variances[static_cast<Eigen::Index>(i % 3)]), 1e-9);
    EXPECT_NEAR(each.InSigmas(), std::abs(each.deviation) / each.sigma, 1e-12);
  }
  EXPECT_TRUE(FindingsOfMerge(merged, TwoOfOneCamera(), {}).empty());
}

TEST(Merge, OfOneTestsNothing) {
  std::vector<CalibrationRecord> parts = TwoOfOneCamera();
  parts.resize(1);
  parts[0].cameras[0].fit = {};
  const MergedCalibrations merged = MergeCalibrations(parts, {});
  EXPECT_NEAR(merged.chi_square, 0, 1e-12);
  EXPECT_EQ(merged.degrees, 0);
  EXPECT_EQ(merged.scale, 1);
  EXPECT_EQ(merged.record.cameras[0].fit.rms, 0);
  EXPECT_EQ(merged.record.cameras[0].fit.noise_sigma, 0);
  for (const MergeDeviation& each : merged.deviations) {
    EXPECT_EQ(each.sigma, 0);
    EXPECT_EQ(each.InSigmas(), 0);
  }
}

// Chi-square with three degrees of freedom reaches 16.27 by chance once in 1000 merges.
TEST(Merge, ScalesBeyondTheChanceOfAllDeviations) {
  for (const double chi_square : {16.2, 16.3}) {
    const double f_x = 500 + std::sqrt(5 * (chi_square - 5.2));
    const MergedCalibrations merged = MergeCalibrations(TwoOfOneCamera(f_x), {});
    EXPECT_NEAR(merged.chi_square, chi_square, 1e-9);
    const double scale = chi_square > 16.25 ? std::sqrt(chi_square / 3) : 1;
    EXPECT_NEAR(merged.scale, scale, 1e-9);
    EXPECT_NEAR(merged.record.cameras[0].Sigma(0), scale * std::sqrt(0.8), 1e-9);
  }
}

TEST(Merge, TakesOpenParametersFromThoseThatKnowThem) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  std::vector<CalibrationRecord> parts = TwoOfOneCamera();
  parts.push_back(parts[1]);
  parts[0].cameras[0].covariance(0, 0) = parts[0].cameras[0].covariance(3, 3) = kInfinity;
  parts[0].cameras[0].params[3] = 1;
  for (CalibrationRecord& part : parts) part.cameras[0].covariance(1, 1) = kInfinity;
  const CalibratedCamera left = MergeCalibrations(parts, {}).record.cameras[0];
  EXPECT_NEAR(left.params[0], 503, 1e-9);
  EXPECT_NEAR(left.Sigma(0), 2 / std::sqrt(2), 1e-9);
  EXPECT_EQ(left.params[1], 400);
  EXPECT_EQ(left.Sigma(1), kInfinity);
  EXPECT_EQ(left.params[3], 240);
  EXPECT_EQ(left.Sigma(3), 0);
}

TEST(Merge, RefusesOtherFixedParameters) {
  std::vector<CalibrationRecord> parts = TwoOfOneCamera();
  parts[1].cameras[0].params[3] = 241;
  EXPECT_EQ(ErrorOfMerge(parts),
            "b.yaml: left.c_y is fixed at 241, elsewhere fixed at 240; calibrate it alike");
  parts[1].cameras[0].covariance(3, 3) = 1;
  EXPECT_EQ(ErrorOfMerge(parts),
            "b.yaml: left.c_y is estimated as 241, elsewhere fixed at 240; calibrate it alike");
  std::swap(parts[0], parts[1]);
  EXPECT_EQ(ErrorOfMerge(parts),
            "a.yaml: left.c_y is fixed at 240, elsewhere estimated as 241; calibrate it alike");
}

// The second has c_x 600 px farther to the right, by which the first one's f_x falls by as much.
TEST(Merge, RefusesAMeanThatNoCameraHas) {
  std::vector<CalibrationRecord> parts{
      Plain("a.yaml",
            {{.name = "left", .params = {500, 400, 320, 240}, .sigmas = {100, 2, 100, 0}}}),
      Plain("b.yaml",
            {{.name = "left", .params = {500, 400, 920, 240}, .sigmas = {1e5, 2, 0.01, 0}}})};
  Eigen::MatrixXd& covariance = parts[0].cameras[0].covariance;
  covariance(0, 2) = covariance(2, 0) = -0.9999 * 100 * 100;
  EXPECT_THAT(RefusalOf([&] { (void)MergeCalibrations(parts, {}); }, ErrorKind::kJob),
              HasSubstr("camera 'left': the calibrations differ so much that together they have "
                        "f_x = -99.9"));
}

TEST(Merge, RefusesOtherSizesAndConstants) {
  std::vector<CalibrationRecord> parts = TwoOfOneCamera();
  parts[1].cameras[0].image_size = {320, 200};
  EXPECT_EQ(ErrorOfMerge(parts), "b.yaml: left has 320 x 200 pixels, in a.yaml 640 x 480");
  const CameraModel* const model = FindModel(CameraModels(), "focused-plenoptic");
  for (CalibrationRecord& part : parts) {
    CalibratedCamera& camera = part.cameras[0];
    camera.image_size = {640, 480};
    camera.model = model;
    camera.params.assign(model->params.size(), 1);
    camera.covariance =
        Eigen::MatrixXd::Identity(std::ssize(model->params), std::ssize(model->params));
    camera.config = {5e-6};
  }
  EXPECT_EQ(ErrorOfMerge(parts), "no refusal");
  parts[1].cameras[0].config = {6e-6};
  EXPECT_EQ(ErrorOfMerge(parts), "b.yaml: left has pixel_size 6e-06, in a.yaml 5e-06");
}

TEST(Merge, RefusesWhatHasNoStandardErrors) {
  EXPECT_EQ(ErrorOfMerge({Plain("a.yaml", {{.name = "left"}})}),
            "a.yaml: has no standard errors, which weight calibrations");
  EXPECT_EQ(ErrorOfMerge({Plain("a.yaml",
                                {{.name = "left", .sigmas = {1, 1, 1, 1}},
                                 {.name = "right", .sigmas = {1, 1, 1, 1}}})}),
            "a.yaml: the extrinsics of right have no standard errors");
}

// A rig of which the extrinsics alone are estimated.
std::vector<CalibrationRecord> TwoOfAPair(double x = -0.104) {
  return {Plain("a.yaml", {{.name = "left"}, {.name = "right", .x = -0.1, .sigma_x = 1e-3}}),
          Plain("b.yaml", {{.name = "left"}, {.name = "right", .x = x, .sigma_x = 2e-3}})};
}

TEST(Merge, WeightsExtrinsics) {
  const MergedCalibrations merged = MergeCalibrations(TwoOfAPair(), {});
  EXPECT_NEAR(merged.record.cameras[1].T_camera_rig.t.x(), -0.1008, 1e-9);
  EXPECT_NEAR(merged.record.cameras[1].sigma_xi[0], std::sqrt(0.8) * 1e-3, 1e-8);
  EXPECT_NEAR(merged.record.cameras[1].sigma_xi[3], std::sqrt(0.8) * 1e-6, 1e-11);
  EXPECT_NEAR(merged.chi_square, 16.0 / 5, 1e-5);
  EXPECT_EQ(merged.degrees, 6);
  EXPECT_THAT(merged.record.correlations.names,
              ElementsAre("right.T_camera_rig.x",
                          "right.T_camera_rig.y",
                          "right.T_camera_rig.z",
                          "right.T_camera_rig.w_x",
                          "right.T_camera_rig.w_y",
                          "right.T_camera_rig.w_z"));
  ASSERT_EQ(merged.deviations.size(), 12U);
  const MergeDeviation &first = merged.deviations[0], &second = merged.deviations[6];
  EXPECT_NEAR(first.deviation, 0.0008, 1e-9);
  EXPECT_NEAR(first.sigma, std::sqrt(0.2) * 1e-3, 1e-8);
  EXPECT_NEAR(second.deviation, -0.0032, 1e-9);
  EXPECT_NEAR(second.sigma, std::sqrt(3.2) * 1e-3, 1e-8);
  EXPECT_EQ(merged.deviations[11].component, 5);
  EXPECT_EQ(first.camera, 1U);
  EXPECT_EQ(first.master, 0U);
  EXPECT_EQ(first.param, std::nullopt);
  EXPECT_EQ(NameOfDeviation(merged, first), "right.T_right_left.x");
  EXPECT_EQ(SizeOfDeviation(merged, second), "-3.2 mm");
}

// Standard errors of the left camera have been multiplied by 3 already.
TEST(Merge, GivesAllCamerasTheFactorOfSharedErrors) {
  std::vector<CalibrationRecord> parts{
      Plain("a.yaml",
            {{.name = "left", .sigmas = {1, 1, 1, 1}},
             {.name = "right", .sigmas = {1, 1, 1, 1}, .x = -0.1, .sigma_x = 1e-3}})};
  parts[0].findings = {{.code = "points_share_errors", .cameras = {"left"}, .value = 3}};
  const CalibrationRecord merged = MergeCalibrations(parts, {}).record;
  EXPECT_NEAR(merged.cameras[0].Sigma(0), 1, 1e-9);
  EXPECT_NEAR(merged.cameras[1].Sigma(0), 3, 1e-9);
  EXPECT_NEAR(merged.cameras[1].sigma_xi[0], 3e-3, 1e-8);
}

// Turned by so much that one linear step does not suffice.
TEST(Merge, DoesNotDependOnTheOrderOfTurnedCameras) {
  std::vector<CalibrationRecord> parts = TwoOfAPair();
  for (size_t p = 0; p < 2; ++p) {
    Vector6d xi;
    xi << -0.1, 0.02, 0.01, 0.1, p == 0 ? 0.3 : 0.5, -0.2;
    parts[p].cameras[1].T_camera_rig = Exp(xi);
    parts[p].cameras[1].sigma_xi = (p == 0 ? 1e-3 : 2e-3) * Vector6d::LinSpaced(6, 1, 2);
  }
  const CalibrationRecord one = MergeCalibrations(parts, {}).record;
  std::swap(parts[0], parts[1]);
  const CalibrationRecord other = MergeCalibrations(parts, {}).record;
  const Vector6d far = LocalCoordinates(one.cameras[1].T_camera_rig, other.cameras[1].T_camera_rig);
  EXPECT_LT(far.norm(), 1e-9);
}

// The camera that moved is alone in the second and the last calibration.
TEST(Merge, GivesACameraThatMovedItsPlaces) {
  const PlainCamera alone{.name = "right", .sigmas = {1, 0, 0, 0}};
  std::vector<CalibrationRecord> parts = TwoOfAPair(-0.2);
  for (CalibrationRecord& part : parts) part.cameras[1].covariance(0, 0) = 1;
  parts.insert(parts.begin() + 1, Plain("alone.yaml", {alone}));
  parts.push_back(Plain("last.yaml", {alone}));
  const MergedCalibrations merged = MergeCalibrations(parts, {.moved = {"right"}});
  EXPECT_NEAR(merged.chi_square, 0, 1e-9);
  EXPECT_EQ(merged.degrees, 2 * 7 + 2 - 13);
  ASSERT_EQ(merged.mounts.size(), 2U);
  for (const size_t i : {0, 1}) {
    const MovedExtrinsics& mount = merged.mounts[i];
    EXPECT_EQ(mount.calibration, 2 * i);
    EXPECT_EQ(mount.camera, 1U);
    EXPECT_NEAR(mount.T_camera_rig.t.x(), i == 0 ? -0.1 : -0.2, 1e-12);
    EXPECT_NEAR(mount.sigma_xi[0], i == 0 ? 1e-3 : 2e-3, 1e-9);
  }
  const CalibratedCamera& right = merged.record.cameras[1];
  EXPECT_NEAR(right.T_camera_rig.t.x(), -0.2, 1e-12);
  EXPECT_NEAR(right.sigma_xi[0], 2e-3, 1e-9);
  EXPECT_NEAR(right.Sigma(0), 0.5, 1e-9);
}

TEST(Merge, RefusesToMoveTheFirstAndUnknownCameras) {
  EXPECT_EQ(ErrorOfMerge(TwoOfAPair(), {.moved = {"left"}}),
            "the rig's frame is that of 'left', so that others move: name these, or give a "
            "calibration with another first camera first");
  EXPECT_THAT(ErrorOfMerge(TwoOfAPair(), {.moved = {"rigt"}}), HasSubstr("no camera 'rigt'"));
  // A camera that is placed by one that moved alone.
  std::vector<CalibrationRecord> parts = TwoOfAPair();
  parts[1] = Plain("b.yaml", {{.name = "right"}, {.name = "top", .x = -0.1, .sigma_x = 1e-3}});
  EXPECT_EQ(ErrorOfMerge(parts), "no refusal");
  EXPECT_EQ(ErrorOfMerge(parts, {.moved = {"right"}}),
            "b.yaml: nothing in the calibrations places right with respect to left");
}

// Three cameras, of which the second and the third have moved by so many sigmas of the difference.
std::vector<CalibrationRecord> TwoOfThree(double second, double third) {
  const auto at = [](const std::string& path, double x, double y) {
    return Plain(path,
                 {{.name = "left"},
                  {.name = "right", .x = x, .sigma_x = 1e-3},
                  {.name = "top", .x = y, .sigma_x = 1e-3}});
  };
  const double sigma = 1e-3 * std::sqrt(2);
  return {at("a.yaml", -0.1, -0.2), at("b.yaml", -0.1 + second * sigma, -0.2 + third * sigma)};
}

std::vector<Finding> FindingsOf(const std::vector<CalibrationRecord>& parts,
                                const MergeOptions& options = {}) {
  return FindingsOfMerge(MergeCalibrations(parts, options), parts, options);
}

TEST(Merge, NamesTheCameraThatMoved) {
  EXPECT_TRUE(FindingsOf(TwoOfThree(0, 4)).empty());  // 16 of 32.9
  const std::vector<Finding> found = FindingsOf(TwoOfThree(0, 6));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].code, "mount_moved");
  EXPECT_EQ(found[0].grade, Grade::kUsable);
  EXPECT_THAT(found[0].cameras, ElementsAre("top"));
  EXPECT_NEAR(found[0].value.value(), std::sqrt(36.0 / 12), 1e-4);
  EXPECT_EQ(found[0].limit, 1);
  EXPECT_EQ(found[0].what,
            "top moved on the rig between the calibrations: with a place of its own in each of "
            "them they agree.");
  EXPECT_EQ(found[0].remedy, "Merge with '--moved top': the result has its last place.");
  EXPECT_TRUE(FindingsOf(TwoOfThree(0, 6), {.moved = {"top"}}).empty());
  // Of two that would do, the one that leaves less: 4.2^2 or 4.4^2 of 22.5 that chance allows.
  EXPECT_THAT(FindingsOf(TwoOfThree(4.2, 4.4)).at(0).cameras, ElementsAre("top"));
  EXPECT_THAT(FindingsOf(TwoOfThree(4.4, 4.2)).at(0).cameras, ElementsAre("right"));
  // Of two that moved neither alone, and the second one beside the first.
  EXPECT_EQ(FindingsOf(TwoOfThree(9, 9)).at(0).code, "calibrations_disagree");
  EXPECT_THAT(FindingsOf(TwoOfThree(9, 9), {.moved = {"right"}}).at(0).cameras, ElementsAre("top"));
}

TEST(Merge, NamesTheThreeFarthestUnknowns) {
  std::vector<CalibrationRecord> parts = TwoOfOneCamera(520);
  parts[1].cameras[0].params[1] = 440;
  const std::vector<Finding> found = FindingsOf(parts);
  ASSERT_EQ(found.size(), 3U);
  for (const Finding& finding : found) {
    EXPECT_EQ(finding.code, "calibrations_disagree");
    EXPECT_EQ(finding.grade, Grade::kUsable);
    EXPECT_THAT(finding.cameras, ElementsAre("left"));
    EXPECT_EQ(finding.limit, 3);
  }
  EXPECT_NEAR(found[0].value.value(), 40 / std::sqrt(5), 1e-9);
  EXPECT_NEAR(found[2].value.value(), 20 / std::sqrt(5), 1e-9);
  const auto what = [&](size_t i) { return found[i].what; };
  // Two that are as far: 40 * 4 / 5 and 40 / 5 of the sum.
  EXPECT_THAT(std::vector({what(0), what(1)}),
              ::testing::UnorderedElementsAre(
                  "left.f_y: a.yaml is -32 px away from all calibrations together, 17.9 sigma.",
                  "left.f_y: b.yaml is 8 px away from all calibrations together, 17.9 sigma."));
  EXPECT_THAT(what(2), HasSubstr("left.f_x: "));
  // Those below three sigmas are not named: 2.95 sqrt(5) and a larger one.
  parts[1].cameras[0].params = {500 + 2.95 * std::sqrt(5), 400 + 3.05 * std::sqrt(5), 320, 240};
  std::vector<std::string> names;
  for (const Finding& finding : FindingsOf(parts)) names.push_back(finding.what.substr(0, 9));
  EXPECT_THAT(names, ElementsAre("left.f_y:", "left.f_y:"));
}

TEST(Merge, NamesDeviationsWithTheirUnits) {
  MergedCalibrations merged;
  merged.record = Plain("a.yaml", {{.name = "left"}, {.name = "right"}});
  merged.record.cameras[1].model = FindModel(CameraModels(), "pinhole-radial3");
  MergeDeviation deviation{.camera = 1, .param = 4, .deviation = -0.0123456};
  EXPECT_EQ(NameOfDeviation(merged, deviation), "right.A_0");
  EXPECT_EQ(SizeOfDeviation(merged, deviation), "-0.0123");
  deviation.param = 3;
  EXPECT_EQ(NameOfDeviation(merged, deviation), "right.c_y");
  EXPECT_EQ(SizeOfDeviation(merged, deviation), "-0.0123 px");
  deviation.param.reset();
  deviation.component = 2;
  EXPECT_EQ(NameOfDeviation(merged, deviation), "right.T_right_left.z");
  EXPECT_EQ(SizeOfDeviation(merged, deviation), "-12.3 mm");
  deviation.component = 3;
  EXPECT_EQ(NameOfDeviation(merged, deviation), "right.T_right_left.w_x");
  EXPECT_EQ(SizeOfDeviation(merged, deviation), "-0.707 degrees");
  deviation.sigma = 0.00123456;
  EXPECT_NEAR(deviation.InSigmas(), 10, 1e-9);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
