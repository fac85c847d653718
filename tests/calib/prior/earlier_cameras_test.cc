// SPDX-License-Identifier: Apache-2.0
#include "calib/prior/earlier_cameras.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <limits>
#include <string>
#include <vector>

#include "calib/prior/calibrated_rig.h"
#include "models/registry.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A calibration of these cameras, whose standard errors grow by parameter and camera. f_x and f_y
// are correlated; A_2 is fixed.
CalibrationRecord Earlier(const std::vector<std::string>& names) {
  CalibrationRecord record;
  record.path = "earlier.yaml";
  Vector6d xi = Vector6d::Zero();
  double sigma = 0.1;
  for (const std::string& name : names) {
    CalibratedCamera& camera = record.cameras.emplace_back();
    camera.name = name;
    camera.model = FindModel(CameraModels(), "pinhole-radial3");
    camera.image_size = {640, 480};
    camera.params = {500, 502, 320, 240, -0.2, 0.05, 0.01};
    Eigen::VectorXd sigmas(7);
    for (double& each : sigmas.head<6>()) each = sigma += 0.1;
    sigmas[6] = 0;
    camera.covariance = sigmas.cwiseAbs2().asDiagonal();
    camera.covariance(0, 1) = camera.covariance(1, 0) = 0.5 * sigmas[0] * sigmas[1];
    camera.T_camera_rig = Exp(xi);
    if (!xi.isZero()) camera.sigma_xi << 1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3;
    xi += (Vector6d() << -0.1, 0.02, 0.01, 0.1, 0.3, -0.2).finished();
  }
  return record;
}

std::vector<CameraInput> Session(const std::vector<std::string>& names) {
  std::vector<CameraInput> inputs;
  for (const std::string& name : names) {
    CameraInput& input = inputs.emplace_back();
    input.name = name;
    input.model = FindModel(CameraModels(), "pinhole-radial3");
    input.image_size = {640, 480};
    input.initial.resize(7);
    input.fixed.resize(7, false);
  }
  return inputs;
}

// "left 0" of parameters, "left T0" of extrinsics.
std::vector<std::string> UnknownsOf(const EarlierCameras& cameras) {
  std::vector<std::string> names;
  for (const CalibrationPrior::Unknown& unknown : cameras.prior->unknowns) {
    const std::string& camera = cameras.inputs[unknown.camera].name;
    names.push_back(unknown.param ? camera + " " + std::to_string(*unknown.param)
                                  : camera + " T" + std::to_string(unknown.component));
  }
  return names;
}

Eigen::MatrixXd CovarianceOf(const CalibrationPrior& prior) {
  return (prior.weight.transpose() * prior.weight).inverse();
}

EarlierCameras Use(const CalibrationRecord& record,
                   std::vector<CameraInput> inputs,
                   std::vector<EarlierParams> keys = {},
                   const EarlierOptions& options = {}) {
  EarlierSource source{.record = &record, .cameras = {}};
  for (size_t c = 0; c < inputs.size(); ++c) source.cameras.push_back(c);
  keys.resize(inputs.size());
  return UseEarlierCalibrations(std::move(inputs), keys, {source}, options);
}

std::string ErrorOf(const CalibrationRecord& record,
                    const std::vector<CameraInput>& inputs,
                    bool is_named = false) {
  EarlierSource source{.record = &record, .cameras = {}, .is_named = is_named};
  for (size_t c = 0; c < inputs.size(); ++c) source.cameras.push_back(c);
  return RefusalOf([&] {
    (void)UseEarlierCalibrations(
        inputs, std::vector<EarlierParams>(inputs.size()), {source}, EarlierOptions{});
  });
}

TEST(EarlierCameras, GiveStartValuesAndAPrior) {
  const CalibrationRecord record = Earlier({"left", "right"});
  // Not in the order of the calibration's cameras, and one more between them.
  const EarlierCameras found = Use(record, Session({"left", "top", "right"}));
  for (const size_t c : {size_t{0}, size_t{2}}) {
    for (size_t k = 0; k < 7; ++k)
      EXPECT_EQ(found.inputs[c].initial[k], record.cameras[0].params[k]);
    EXPECT_EQ(found.inputs[c].fixed, (std::vector<bool>{0, 0, 0, 0, 0, 0, 1}));
  }
  EXPECT_THAT(found.inputs[1].initial, Each(std::nullopt));
  EXPECT_THAT(found.inputs[1].fixed, Each(false));
  EXPECT_THAT(found.without_sigmas, Each(false));
  EXPECT_EQ(found.fixed_extrinsics, (std::vector<bool>{true, false, false}));
  EXPECT_FALSE(found.T_camera_rig[1]);
  EXPECT_LT((Log(*found.T_camera_rig[2]) - Log(record.cameras[1].T_camera_rig)).norm(), 1e-12);

  EXPECT_THAT(UnknownsOf(found),
              ElementsAre("left 0",
                          "left 1",
                          "left 2",
                          "left 3",
                          "left 4",
                          "left 5",
                          "right 0",
                          "right 1",
                          "right 2",
                          "right 3",
                          "right 4",
                          "right 5",
                          "right T0",
                          "right T1",
                          "right T2",
                          "right T3",
                          "right T4",
                          "right T5"));
  const Eigen::MatrixXd covariance = CovarianceOf(*found.prior);
  for (const Eigen::Index c : {0, 1}) {
    const Eigen::MatrixXd& expected = record.cameras[static_cast<size_t>(c)].covariance;
    EXPECT_LT((covariance.block<6, 6>(6 * c, 6 * c) - expected.topLeftCorner<6, 6>()).norm(), 1e-9);
  }
  ASSERT_EQ(found.prior->T_camera_rig.size(), 3U);
  EXPECT_LT((Log(found.prior->T_camera_rig[2]) - Log(*found.T_camera_rig[2])).norm(), 1e-12);
}

TEST(EarlierCameras, KeysChooseTheUnknownsOfThePrior) {
  const CalibrationRecord record = Earlier({"left", "right"});
  std::vector<CameraInput> inputs = Session({"left", "right"});
  inputs[0].initial[1] = 510;  // the session's value goes before
  EarlierParams left{.prior = {{1, 4}}}, right{.free = {0, 6}, .free_extrinsics = true};
  const EarlierCameras found = Use(record, inputs, {left, right});
  EXPECT_THAT(
      UnknownsOf(found),
      ElementsAre("left 1", "left 4", "right 1", "right 2", "right 3", "right 4", "right 5"));
  EXPECT_EQ(found.inputs[0].initial[1], 510);
  EXPECT_EQ(found.inputs[0].initial[0], 500);
  EXPECT_FALSE(found.inputs[0].fixed[0]);
  EXPECT_EQ(found.inputs[1].initial[0], std::nullopt);
  EXPECT_FALSE(found.inputs[1].fixed[6]);
  EXPECT_TRUE(found.inputs[0].fixed[6]);
  EXPECT_TRUE(found.T_camera_rig[1]);
  // The marginal variance of f_y, which is correlated with f_x.
  EXPECT_NEAR(CovarianceOf(*found.prior)(0, 0), record.cameras[0].covariance(1, 1), 1e-9);
}

TEST(EarlierCameras, FixWhatIsOpenOrEverything) {
  CalibrationRecord record = Earlier({"left", "right"});
  record.cameras[0].covariance(2, 2) = kInfinity;
  const EarlierCameras fixed = Use(record, Session({"left", "right"}));
  EXPECT_EQ(fixed.inputs[0].fixed, (std::vector<bool>{0, 0, 1, 0, 0, 0, 1}));
  const EarlierCameras free =
      Use(record, Session({"left", "right"}), {}, {.open = OpenParams::kFree});
  EXPECT_EQ(free.inputs[0].fixed, (std::vector<bool>{0, 0, 0, 0, 0, 0, 1}));
  EXPECT_EQ(free.prior->unknowns.size(), 5U + 6 + 6);
  const EarlierCameras all =
      Use(record, Session({"left", "right"}), {}, {.intrinsics = EarlierIntrinsics::kFixed});
  EXPECT_THAT(all.inputs[0].fixed, Each(true));
  EXPECT_FALSE(all.prior);
  EXPECT_TRUE(all.T_camera_rig[1]);
}

TEST(EarlierCameras, WithoutStandardErrorsAreFixed) {
  CalibrationRecord record = Earlier({"left", "right"});
  for (CalibratedCamera& camera : record.cameras) {
    camera.covariance.setZero();
    camera.sigma_xi.setZero();
  }
  const EarlierCameras found = Use(record, Session({"left", "right"}));
  EXPECT_THAT(found.without_sigmas, Each(true));
  EXPECT_THAT(found.inputs[1].fixed, Each(true));
  EXPECT_EQ(found.fixed_extrinsics, (std::vector<bool>{true, true}));
  EXPECT_FALSE(found.prior);
}

TEST(EarlierCameras, OfTwoCalibrationsHaveIndependentPriors) {
  const CalibrationRecord left = Earlier({"left"}), right = Earlier({"other"});
  const EarlierCameras found = UseEarlierCalibrations(
      Session({"left", "right"}),
      {{.prior = {{0, 1}}}, {.prior = {{0, 1}}}},
      {{.record = &left, .cameras = {0}}, {.record = &right, .cameras = {1}, .is_named = true}},
      {});
  EXPECT_THAT(UnknownsOf(found), ElementsAre("left 0", "left 1", "right 0", "right 1"));
  Eigen::Matrix4d expected = Eigen::Matrix4d::Zero();
  expected.topLeftCorner<2, 2>() = left.cameras[0].covariance.topLeftCorner<2, 2>();
  expected.bottomRightCorner<2, 2>() = expected.topLeftCorner<2, 2>();
  EXPECT_LT((CovarianceOf(*found.prior) - expected).norm(), 1e-9);
  // The second camera has no extrinsics.
  EXPECT_FALSE(found.T_camera_rig[1]);
  EXPECT_EQ(found.prior->T_camera_rig.size(), 2U);
}

TEST(EarlierCameras, MustBeAlike) {
  CalibrationRecord record = Earlier({"left", "right"});
  EXPECT_EQ(ErrorOf(record, Session({"left"})), "no refusal");
  EXPECT_THAT(ErrorOf(record, Session({"top"})), HasSubstr("has none of the session's cameras"));
  EXPECT_THAT(ErrorOf(record, Session({"top"}), true), HasSubstr("top"));
  EXPECT_EQ(ErrorOf(Earlier({"left"}), Session({"top"}), true), "no refusal");
  EXPECT_EQ(ErrorOf(record, Session({"top", "right"})), "no refusal");
  CalibrationRecord three = Earlier({"left", "right", "back"});
  EXPECT_THAT(ErrorOf(three, Session({"top", "right", "back"})),
              HasSubstr("has not the session's first camera, top, but others"));

  std::vector<CameraInput> inputs = Session({"left"});
  inputs[0].image_size = {320, 480};
  EXPECT_THAT(ErrorOf(record, inputs),
              HasSubstr("images of 640 x 480 pixels, these are 320 x 480;"));
  inputs[0].image_size = {};
  EXPECT_EQ(ErrorOf(record, inputs), "no refusal");
  record.cameras[0].image_size = {};
  inputs[0].image_size = {320, 480};
  EXPECT_EQ(ErrorOf(record, inputs), "no refusal");
  inputs[0].model = FindModel(CameraModels(), "pinhole");
  EXPECT_THAT(ErrorOf(record, inputs),
              HasSubstr("left has model pinhole-radial3, the session has pinhole;"));
}

TEST(EarlierCameras, FixedParametersNeedAValue) {
  const CalibrationRecord record = Earlier({"left"});
  std::vector<CameraInput> inputs = Session({"left"});
  inputs[0].fixed[3] = true;
  EXPECT_EQ(ErrorOf(record, inputs), "no refusal");
  EXPECT_THAT(RefusalOf([&] { (void)Use(record, inputs, {{.free = {3}}}); }),
              HasSubstr("left: 'c_y' is to be fixed"));
}

// Standard errors of the left camera were multiplied by 3, those of the right one by 1.5.
TEST(EarlierCameras, GetTheLargestFactorOfSystematicErrors) {
  CalibrationRecord record = Earlier({"left", "right"});
  const Eigen::MatrixXd once = CovarianceOf(*Use(record, Session({"left", "right"})).prior);
  record.findings = {{.code = "points_share_errors", .cameras = {"left"}, .value = 3},
                     {.code = "other", .cameras = {"right"}, .value = 100}};
  record.verdict.emplace();
  record.verdict->findings = {{.code = "points_share_errors", .cameras = {"right"}, .value = 1.5}};
  const Eigen::MatrixXd found = CovarianceOf(*Use(record, Session({"left", "right"})).prior);
  Eigen::VectorXd factors = Eigen::VectorXd::Constant(18, 2);
  factors.head<6>().setOnes();
  const Eigen::MatrixXd expected = factors.asDiagonal() * once * factors.asDiagonal();
  EXPECT_LT((found - expected).norm(), 1e-9 * expected.norm());

  record.findings[0].value = kInfinity;
  EXPECT_THAT(ErrorOf(record, Session({"left", "right"})),
              HasSubstr("the finding points_share_errors of left has no finite value"));
}

TEST(EarlierCameras, MustHaveTheSameConstants) {
  CalibrationRecord record = Earlier({"left"});
  std::vector<CameraInput> inputs = Session({"left"});
  const CameraModel* const model = FindModel(CameraModels(), "focused-plenoptic");
  const size_t count = model->params.size();
  CalibratedCamera& camera = record.cameras[0];
  camera.model = inputs[0].model = model;
  camera.params.assign(count, 1);
  camera.covariance =
      Eigen::MatrixXd::Identity(std::ssize(model->params), std::ssize(model->params));
  inputs[0].initial.resize(count);
  inputs[0].fixed.resize(count, false);
  camera.config = inputs[0].config = {5e-6};
  EXPECT_EQ(ErrorOf(record, inputs), "no refusal");
  inputs[0].config = {6e-6};
  EXPECT_EQ(ErrorOf(record, inputs),
            "earlier.yaml: left has pixel_size 5e-06, the session has 6e-06; use one value");
  // Where one of them states none.
  inputs[0].config.clear();
  EXPECT_EQ(ErrorOf(record, inputs), "no refusal");
}

TEST(EarlierCameras, OfWhichOneIsCommonHaveNoExtrinsics) {
  const EarlierCameras found = Use(Earlier({"left", "right"}), Session({"left"}));
  EXPECT_EQ(found.fixed_extrinsics, std::vector<bool>{false});
  EXPECT_EQ(found.prior->unknowns.size(), 6U);
}

// Both calibrations have the first camera, whose own prior the keys take away from the second.
TEST(EarlierCameras, OfTwoRigsHaveTheirExtrinsics) {
  const CalibrationRecord first = Earlier({"left", "right"});
  CalibrationRecord second = Earlier({"left", "top"});
  second.cameras[1].T_camera_rig.t.x() = 0.7;
  const std::vector<size_t> none;
  const EarlierCameras found =
      UseEarlierCalibrations(Session({"left", "right", "top"}),
                             {{.prior = none}, {.prior = none}, {.prior = none}},
                             {{.record = &first, .cameras = {0, 1}, .is_named = true},
                              {.record = &second, .cameras = {0, 2}, .is_named = true}},
                             {});
  ASSERT_EQ(found.prior->unknowns.size(), 12U);
  EXPECT_EQ(found.prior->unknowns[6].camera, 2U);
  ASSERT_EQ(found.prior->T_camera_rig.size(), 3U);
  for (const size_t c : {1, 2}) {
    const RigidTransform& expected = (c == 1 ? first : second).cameras[1].T_camera_rig;
    EXPECT_LT(LocalCoordinates(expected, found.prior->T_camera_rig[c]).norm(), 1e-12);
    EXPECT_LT(LocalCoordinates(expected, *found.T_camera_rig[c]).norm(), 1e-12);
  }
}

TEST(EarlierCameras, FixedParametersNeedAValueFromTheFirstOn) {
  const CalibrationRecord record = Earlier({"left", "right"});
  for (const size_t k : {0, 6}) {
    std::vector<CameraInput> inputs = Session({"left", "right"});
    inputs[1].fixed[k] = true;
    EXPECT_EQ(RefusalOf([&] {
                (void)Use(record, inputs, {{}, {.free = {k}}});
              }),
              "right: '" + std::string(inputs[1].model->params[k].name) +
                  "' is to be fixed, but neither 'initial' nor the earlier calibration gives a "
                  "value for it");
    inputs[1].initial[k] = 1;
    EXPECT_EQ(Use(record, inputs, {{}, {.free = {k}}}).inputs[1].initial[k], 1);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
