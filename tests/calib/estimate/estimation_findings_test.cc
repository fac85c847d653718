// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/estimation_findings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "calib/base/statistics.h"
#include "calib/estimate/rig_rigidity.h"
#include "calib/prior/merge.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

Bundle Stereo() { return TrueBundle(MakeProblem(12, {.cameras = 2, .frames = 6, .noise = 0.2})); }

TEST(EstimationFindings, OfErrorsPosesAndMisfits) {
  const Finding shared = FindingOfSystematicErrors("left", 2.34);
  EXPECT_EQ(shared.code, "points_share_errors");
  EXPECT_EQ(shared.grade, Grade::kGood);
  EXPECT_EQ(shared.value, 2.34);
  EXPECT_EQ(shared.limit, 1);
  EXPECT_THAT(shared.what, ::testing::StartsWith("left: all standard errors include errors"));
  EXPECT_THAT(shared.what, ::testing::HasSubstr("2.3 times as large as the noise"));
  const Finding pose = FindingOfOnePose(7);
  EXPECT_EQ(pose.what, "All 7 frames show the target from one pose; they count as one.");
  EXPECT_EQ(pose.role, FindingRole::kOpenPoses);
  EXPECT_EQ(pose.grade, Grade::kUsable);
  EXPECT_EQ(pose.value, 7);
  const Finding misfit = FindingOfMisfit("left", "why");
  EXPECT_EQ(misfit.what, "why.");
  EXPECT_EQ(misfit.grade, Grade::kBad);
  EXPECT_EQ(misfit.role, FindingRole::kCause);
  EXPECT_THAT(misfit.cameras, ElementsAre("left"));
}

TEST(EstimationFindings, OfJitterStateItsSigmas) {
  Bundle bundle = Stereo();
  EXPECT_THAT(FindingsOfJitter(bundle), IsEmpty());
  bundle.jitter.translation_sigma = 0.0012;
  bundle.jitter.rotation_sigma = 0.5 * std::numbers::pi / 180;
  bundle.jitter.misplaced = {false, true, true, false};
  std::vector<Finding> found = FindingsOfJitter(bundle);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NEAR(*found[0].value, 0.5, 1e-12);
  EXPECT_EQ(
      found[0].what,
      "The rig is not rigid or its frames are not synchronous: within a frame the target's "
      "pose differs between cameras by 1.2 mm along and 0.5 degrees about each axis (standard "
      "deviation); 2 images that are farther off count for their camera only. Standard errors "
      "include it.");
  bundle.jitter.misplaced.assign(4, false);
  found = FindingsOfJitter(bundle);
  EXPECT_THAT(found[0].what,
              ::testing::EndsWith("(standard deviation). Standard errors include it."));
}

TEST(EstimationFindings, OfTimeShiftsStateTheirSide) {
  Bundle bundle = Stereo();
  Uncertainty uncertainty;
  uncertainty.param_std_errors.assign(2, std::vector<double>(8, 0.00012));
  EXPECT_THAT(FindingsOfTimeShifts(bundle, uncertainty), IsEmpty());
  AddNuisance(nuisances::kTimeShift, 1, &bundle.cameras[1]);
  for (const double shift : {0.0034567, -0.0034567}) {
    bundle.cameras[1].params[7] = shift;
    const std::vector<Finding> found = FindingsOfTimeShifts(bundle, uncertainty);
    ASSERT_EQ(found.size(), 1U);
    EXPECT_EQ(found[0].value, shift);
    EXPECT_EQ(found[0].grade, Grade::kGood);
    EXPECT_THAT(found[0].cameras, ElementsAre("cam1"));
    EXPECT_EQ(found[0].what,
              std::string("cam1: images were taken 3.457 +- 0.12 ms ") +
                  (shift > 0 ? "later" : "earlier") +
                  " than their times, by the clock of cam0. The calibration includes it.");
  }
}

// A prior of sigma 5 whose value images change by 4 sigmas of what they may: 4 of 5 with a standard
// error of 3.
TEST(EstimationFindings, OfScalesStateWhatThePriorAllows) {
  Bundle bundle = Stereo();
  bundle.scales = {{.sigma = 0.003, .value = -0.02}};
  Uncertainty uncertainty;
  uncertainty.scale_index = 0;
  uncertainty.covariance = Eigen::MatrixXd::Constant(1, 1, 1e-6);
  const std::vector<Finding> found = FindingsOfTargetScale(bundle, uncertainty);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].code, "target_scale_contradicted");
  // An estimate differs from a correct prior by the root of the prior's variance less its own.
  EXPECT_NEAR(*found[0].value, 0.02 / std::sqrt(8e-6), 1e-9);
  EXPECT_THAT(
      found[0].what,
      ::testing::HasSubstr(" is -2 +- 0.1 %, 7.1 sigmas of what scale_sigma, 0.3 %, allows."));
  bundle.scales[0].value = 0.011;  // 3.9 sigmas
  EXPECT_THAT(FindingsOfTargetScale(bundle, uncertainty), IsEmpty());
  bundle.scales[0].value = 0.012;  // 4.2 sigmas
  EXPECT_EQ(FindingsOfTargetScale(bundle, uncertainty).size(), 1U);
}

TEST(EstimationFindings, OfRulesAreBoundsAndContradictedPriors) {
  Bundle bundle = Stereo();
  BundleCamera& camera = bundle.cameras[0];
  Uncertainty uncertainty;
  uncertainty.param_std_errors.assign(2, std::vector<double>(7, 3));
  camera.rules.resize(7);
  camera.at_bound.assign(7, false);
  camera.rules[2].prior = {.value = 600, .sigma = 5};
  for (const double away : {15.9, 16.1, -16.1}) {
    camera.params[2] = 600 + away;
    const std::vector<Finding> found = FindingsOfRules(bundle, uncertainty);
    ASSERT_EQ(found.size(), std::abs(away) < 16 ? 0U : 1U);
    if (found.empty()) continue;
    EXPECT_EQ(found[0].code, "prior_contradicted");
    EXPECT_NEAR(*found[0].value, 4.025, 1e-9);
    EXPECT_EQ(found[0].limit, 4);
    EXPECT_EQ(found[0].what,
              std::string("cam0.c_x: images and prior disagree by 4.0 sigma (prior 600 +- 5, with "
                          "the images ") +
                  (away > 0 ? "616.1)." : "583.9)."));
  }
  // No test where images have not gained on the prior, or the parameter is fixed.
  for (const double sigma : {0.0, 5.0, 6.0}) {
    uncertainty.param_std_errors[0][2] = sigma;
    EXPECT_THAT(FindingsOfRules(bundle, uncertainty), IsEmpty()) << sigma;
  }
  camera.at_bound[0] = camera.at_bound[1] = true;
  camera.rules[1].tied_to = ParamIndex{1, 1};
  camera.params[0] = 512.5;
  const std::vector<Finding> found = FindingsOfRules(bundle, uncertainty);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].code, "at_bound");
  EXPECT_EQ(found[0].value, 512.5);
  EXPECT_EQ(found[0].what,
            "cam0.f_x lies on its bound, 512.5: the images ask for a value beyond. It has no "
            "standard error, and those of others are too small if the bound is wrong.");
}

TEST(StartJitter, IsTheDifferenceOfThePosesThatCamerasFound) {
  const SyntheticProblem problem = MakeProblem(12, {.cameras = 2, .frames = 40, .noise = 0.2});
  Bundle bundle = TrueBundle(problem);
  std::vector<std::string> frames;
  for (const auto& [frame, pose] : problem.T_rig_target) frames.push_back(frame);
  Random random(6);
  std::vector<CameraGuess> guesses(2);
  std::vector<Vector6d> deltas;
  for (size_t c = 0; c < 2; ++c) {
    for (const View& view : problem.input.cameras[c].views) {
      const RigidTransform& T_rig_target = problem.T_rig_target.at(view.frame);
      Vector6d delta = Vector6d::Zero();
      // The centre of the target by 2 mm, its rotation by 0.01 rad; the first camera gave the
      // poses.
      if (c == 1) {
        const Eigen::Vector3d w = random.Gaussians<3>(0.01);
        const Eigen::Vector3d centre = T_rig_target.R * Eigen::Vector3d(0.135, 0.09, 0);
        delta << random.Gaussians<3>(0.002) - w.cross(centre), w;
      }
      guesses[c].T_camera_target.emplace_back(problem.T_camera_rig[c] *
                                              Retract(T_rig_target, delta));
      deltas.push_back(delta);
    }
  }
  guesses[1].T_camera_target[3].reset();
  StartJitter(problem.input.cameras, guesses, frames, &bundle);
  ASSERT_EQ(bundle.jitter.delta.size(), 80U);
  EXPECT_EQ(bundle.jitter.misplaced, std::vector<bool>(80, false));
  EXPECT_LT((bundle.jitter.delta[bundle.View(5, 1)] - deltas[45]).norm(), 1e-9);
  EXPECT_EQ(bundle.jitter.delta[bundle.View(3, 1)], Vector6d::Zero());
  EXPECT_LT(bundle.jitter.delta[bundle.View(5, 0)].norm(), 1e-12);
  // Medians of 39 lengths have an error of about a tenth.
  EXPECT_NEAR(bundle.jitter.translation_sigma, 0.002, 0.0006);
  EXPECT_NEAR(bundle.jitter.rotation_sigma, 0.01, 0.003);
}

TEST(UpdateJitter, ScalesSigmasToTheirRedundancyAndFindsMisplacedViews) {
  Bundle bundle = Stereo();
  EXPECT_EQ(UpdateJitter({}, &bundle), 0);
  Jitter& jitter = bundle.jitter;
  jitter.translation_sigma = 0.002, jitter.rotation_sigma = 0.01;
  jitter.delta.assign(12, Vector6d::Zero());
  jitter.misplaced.assign(12, false);
  const auto set = [&](size_t view, double translation, double rotation) {
    const Eigen::Vector3d centre =
        bundle.T_rig_target[view / 2].R * Eigen::Vector3d(0.135, 0.09, 0);
    const Eigen::Vector3d w(0, rotation, 0);
    jitter.delta[view] << Eigen::Vector3d(translation, 0, 0) - w.cross(centre), w;
  };
  for (size_t view = 0; view < 12; ++view) set(view, 0.004, 0.005);  // 2 and 1/2 sigmas
  set(7, 0.004, 0.9);
  jitter.misplaced[7] = true;  // does not count
  Uncertainty uncertainty;
  uncertainty.jitter_translation_redundancy = 22;
  uncertainty.jitter_rotation_redundancy = 11;
  const double translation = std::sqrt(11 * 4.0 / 22), rotation = std::sqrt(11 * 0.25 / 11);
  EXPECT_NEAR(UpdateJitter(uncertainty, &bundle), std::max(translation - 1, 1 - rotation), 1e-9);
  EXPECT_NEAR(jitter.translation_sigma, 0.002 * translation, 1e-9);
  EXPECT_NEAR(jitter.rotation_sigma, 0.01 * rotation, 1e-9);
  for (size_t view = 0; view < 12; ++view) EXPECT_EQ(jitter.misplaced[view], view == 7) << view;
  // Chi-square of six degrees of freedom that one of 12 views exceeds once in 20 sessions.
  const double limit = std::sqrt(ChiSquareQuantile(6, 0.05 / 12));
  for (const double part : {0.98, 1.02}) {
    jitter.translation_sigma = 0.002, jitter.rotation_sigma = 0.01;
    for (size_t view = 0; view < 12; ++view) set(view, 0, 0.01);
    jitter.misplaced.assign(12, false);
    jitter.misplaced[7] = true;
    uncertainty.jitter_translation_redundancy = 0;  // not determined: stays
    uncertainty.jitter_rotation_redundancy = 11;
    set(7, 0.002 * part * limit, 0);
    UpdateJitter(uncertainty, &bundle);
    EXPECT_EQ(jitter.translation_sigma, 0.002);
    EXPECT_EQ(jitter.misplaced[7], part > 1);
  }
}

TEST(FramesAgree, UnlessACamerasOwnPosesExplainMostOfItsResiduals) {
  Bundle bundle = Stereo();
  Uncertainty uncertainty;
  const std::vector<double> sigmas{0.2, 0.2};
  // Noise as it is estimated: the squares of residuals in sigmas are as many as coordinates.
  const auto redundancy = [&] {
    std::vector<double> squares(2, 0);
    uncertainty.redundancy.assign(2, 0);
    for (const BundleObservation& each : bundle.observations) {
      double residual[kMaxObservationSize];
      EXPECT_TRUE(Residual(bundle, each, residual));
      const auto c = static_cast<size_t>(each.camera);
      squares[c] += std::pow(WeightedLength(bundle, each, residual), 2);
      uncertainty.redundancy[c] += 2;
    }
    for (size_t c = 0; c < 2; ++c) {
      bundle.cameras[c].noise.detector_scale *= std::sqrt(squares[c] / uncertainty.redundancy[c]);
    }
  };
  redundancy();
  EXPECT_TRUE(FramesAgree(bundle, uncertainty, sigmas));
  // Poses of the second camera's views differ.
  for (BundleObservation& each : bundle.observations) {
    if (each.camera == 1) each.seen.values[0] += each.frame % 2 == 0 ? 1 : -1;
  }
  redundancy();
  EXPECT_FALSE(FramesAgree(bundle, uncertainty, sigmas));
  EXPECT_TRUE(FramesAgree(bundle, uncertainty, std::vector<double>{1e-7, 1e-7}));
}

TEST(MergeDeviations, HaveNamesAndSizes) {
  MergedCalibrations merged;
  const SyntheticProblem problem = MakeProblem(1, {.frames = 1});
  for (const char* name : {"left", "right"}) {
    merged.record.cameras.emplace_back().name = name;
    merged.record.cameras.back().model = problem.input.cameras[0].model;
  }
  MergeDeviation deviation;
  deviation.camera = 1;
  deviation.deviation = -0.0123;
  deviation.component = 2;
  EXPECT_EQ(NameOfDeviation(merged, deviation), "right.T_right_left.z");
  EXPECT_EQ(SizeOfDeviation(merged, deviation), "-12.3 mm");
  deviation.component = 3;
  EXPECT_EQ(NameOfDeviation(merged, deviation), "right.T_right_left.w_x");
  EXPECT_EQ(SizeOfDeviation(merged, deviation), "-0.705 degrees");
  deviation.param = 0;
  EXPECT_EQ(NameOfDeviation(merged, deviation), "right.f_x");
  EXPECT_EQ(SizeOfDeviation(merged, deviation), "-0.0123 px");
  deviation.param = 4;
  EXPECT_EQ(SizeOfDeviation(merged, deviation), "-0.0123");
  EXPECT_EQ(deviation.InSigmas(), 0);
  deviation.sigma = 0.0041;
  EXPECT_NEAR(deviation.InSigmas(), 3, 1e-12);
}

TEST(MergeFindings, NameTheFarthestThreeBeyondThreeSigmas) {
  MergedCalibrations merged;
  merged.record.cameras.emplace_back().name = "left";
  merged.record.cameras.back().model = MakeProblem(1, {.frames = 1}).input.cameras[0].model;
  std::vector<CalibrationRecord> parts(2);
  parts[1].path = "b/calibration.yaml";
  for (size_t k = 0; k < 5; ++k) {
    MergeDeviation deviation;
    deviation.calibration = 1;
    deviation.param = k;
    deviation.deviation = k % 2 == 0 ? 0.5 : -0.5;
    deviation.sigma = 0.5 / std::array{2.9, 3.5, 5.0, 3.1, 4.0}[k];
    merged.deviations.push_back(deviation);
  }
  EXPECT_THAT(FindingsOfMerge(merged, parts, {}), IsEmpty());  // they agree
  merged.scale = 2;
  const std::vector<Finding> found = FindingsOfMerge(merged, parts, {});
  ASSERT_EQ(found.size(), 3U);
  EXPECT_EQ(
      found[0].what,
      "left.c_x: b/calibration.yaml is 0.5 px away from all calibrations together, 5.0 sigma.");
  EXPECT_NEAR(*found[0].value, 5, 1e-9);
  EXPECT_EQ(found[0].limit, 3);
  EXPECT_EQ(found[0].grade, Grade::kUsable);
  EXPECT_THAT(found[0].cameras, ElementsAre("left"));
  EXPECT_NEAR(*found[1].value, 4, 1e-9);
  EXPECT_EQ(
      found[2].what,
      "left.f_y: b/calibration.yaml is -0.5 px away from all calibrations together, 3.5 sigma.");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
