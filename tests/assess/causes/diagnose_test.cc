// SPDX-License-Identifier: Apache-2.0
//
// What the causes found before leave to be tested, and which of lens and target is named.
#include "assess/causes/diagnose.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "assess/causes/lens_cause.h"
#include "calib/base/robust.h"
#include "calib/estimate/describe.h"
#include "calib/start/camera_guess.h"
#include "models/registry.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::IsSupersetOf;
using ::testing::Not;

constexpr double kNoise = 0.1;  // px

const CameraModel& Model(const char* name) { return *FindModel(CameraModels(), name); }

// With every third point of the board where that is enough.
SyntheticProblem Problem(const char* model, int cameras = 1) {
  SyntheticProblem problem =
      MakeProblem(775, {.cameras = cameras, .frames = cameras > 1 ? 10 : 6, .noise = kNoise});
  for (CameraInput& camera : problem.input.cameras) {
    if (camera.model != &Model(model)) SetModel(Model(model), &camera);
    for (View& view : camera.views) {
      for (Observation& seen : view.observations) seen.detector_sigma = kNoise;
      if (cameras > 1) continue;
      std::erase_if(view.observations, [](const auto& seen) { return seen.marker % 3 != 0; });
    }
  }
  return problem;
}

/// A calibration, and what has been found of it.
struct Session {
  explicit Session(SyntheticProblem made)
      : problem(std::move(made)),
        calibration(Calibrate(problem.input, {.threads = 1, .progress = {}})),
        record(Describe(calibration)) {}

  std::vector<std::string> Diagnosed(const std::vector<Finding>& findings = {},
                                     const std::vector<CameraModel>& models = {},
                                     const std::vector<CameraTraits>& traits = {}) {
    record.findings = findings;
    record.verdict.reset();
    Diagnose(
        problem.input, calibration, traits, models, [] { return true; }, &record);
    EXPECT_TRUE(record.verdict);
    return CodesOf(record.findings);
  }

  SyntheticProblem problem;
  Calibration calibration;
  CalibrationRecord record;
};

Finding Of(const std::string& code, FindingRole role, Grade grade = Grade::kBad) {
  return {.code = code, .role = role, .grade = grade};
}

TEST(Diagnose, AddsNothingToARightCalibration) {
  Session session(Problem("pinhole-radial3"));
  EXPECT_THAT(session.Diagnosed({}, {Model("pinhole-radtan8")}), ElementsAre());
}

// A lens that another model describes up to noise makes target and rig disagree.
TEST(Diagnose, NamesTheLensInPlaceOfItsConsequences) {
  Session session(Problem("pinhole"));
  const std::vector<CameraModel> models{Model("pinhole-radial3")};
  const std::string& name = session.problem.input.cameras[0].name;
  Finding misfit = Of("model_misfit", FindingRole::kCause), other = misfit;
  misfit.cameras = {name};
  other.cameras = {"other"};
  const std::vector<Finding> before{Of("residuals", FindingRole::kTargetResiduals),
                                    Of("rig", FindingRole::kRigCause, Grade::kGood),
                                    Of("note", FindingRole::kTargetCause, Grade::kGood),
                                    misfit,
                                    other};
  CameraFit& fit = session.record.cameras[0].fit;
  const std::vector<std::string> codes = session.Diagnosed(before, models);
  EXPECT_THAT(codes, IsSupersetOf({"note", "model_misfit", "strong_distortion_pinhole"}));
  EXPECT_EQ(std::ranges::count(codes, "model_misfit"), 1);
  EXPECT_THAT(codes, Not(Contains("residuals")));
  EXPECT_THAT(codes, Not(Contains("rig")));
  EXPECT_THAT(codes, Not(Contains("target_not_flat")));
  // Half of the residuals of the better model: not all is explained.
  const double residual = FindLensCause(session.problem.input, 0, models).value().residual;
  const auto keeps = [&](double detector_sigma, double noise_sigma) {
    fit.detector_sigma = detector_sigma, fit.noise_sigma = noise_sigma;
    const std::vector<std::string> found = session.Diagnosed(before, models);
    const bool kept = std::ranges::count(found, "residuals") > 0;
    EXPECT_EQ(std::ranges::count(found, "rig") > 0, kept);
    // Nothing is named beside a target that may be wrong.
    EXPECT_EQ(std::ranges::count(found, "strong_distortion_pinhole") > 0, !kept);
    return kept;
  };
  const double noise = fit.noise_sigma;
  EXPECT_FALSE(keeps(0.51 * residual, noise));
  EXPECT_TRUE(keeps(0.49 * residual, noise));
  EXPECT_TRUE(keeps(0, 9.9 * residual));
}

TEST(Diagnose, TriesNoLensBesideAWrongTarget) {
  Session session(Problem("pinhole"));
  const std::vector<CameraModel> models{Model("pinhole-radial3")};
  EXPECT_THAT(session.Diagnosed({Of("x", FindingRole::kTargetCause, Grade::kUsable)}, models),
              ElementsAre("x"));
  EXPECT_THAT(session.Diagnosed({Of("x", FindingRole::kTargetCause, Grade::kGood)}, models),
              Contains("strong_distortion_pinhole"));
  EXPECT_THAT(session.Diagnosed({Of("x", FindingRole::kRigCause)}, models),
              Contains("strong_distortion_pinhole"));
}

TEST(Diagnose, NamesABentTargetUnlessImagesAreDistorted) {
  SyntheticProblem problem = Problem("pinhole-radial3");
  for (auto& [number, p] : problem.input.markers) {
    p.z() = 0.003 * std::pow((p.x() - 0.135) / 0.135, 2);
  }
  Session session(std::move(problem));
  EXPECT_THAT(session.Diagnosed(), Contains("target_not_flat"));
  EXPECT_THAT(session.Diagnosed({Of("x", FindingRole::kImageDistortion)}),
              Not(Contains("target_not_flat")));
  EXPECT_THAT(session.Diagnosed({Of("x", FindingRole::kTargetResiduals)}), ElementsAre("x"));
  EXPECT_THAT(session.Diagnosed({Of("x", FindingRole::kTargetResiduals, Grade::kGood)}),
              Contains("target_not_flat"));
}

// Of each stage one: copies, tags of the files, points at the border and frames.
TEST(Diagnose, RunsTheStagesOfEachCamera) {
  Session session(Problem("pinhole-radial3", 2));
  Bundle& bundle = session.calibration.bundle;
  const std::vector<CameraTraits> traits{{}, {{"a", {.orientation = 6}}}};
  EXPECT_THAT(session.Diagnosed({}, {}, traits), ElementsAre("orientation_tag"));
  EXPECT_THAT(session.record.findings[0].cameras, ElementsAre(bundle.cameras[1].name));
  EXPECT_THAT(session.Diagnosed({}, {}, {{}}), ElementsAre());
  EXPECT_THAT(session.Diagnosed({}, {}, {{{"a", {.orientation = 6}}}}),
              ElementsAre("orientation_tag"));
  EXPECT_THAT(session.record.findings[0].cameras, ElementsAre(bundle.cameras[0].name));

  bundle.jitter.delta.assign(2 * bundle.T_rig_target.size(), Vector6d::Zero());
  for (size_t f = 0; f < bundle.T_rig_target.size(); ++f) {
    bundle.jitter.delta[bundle.View(f, 1)].setConstant(f % 2 == 0 ? 1e-3 : -1e-3);
  }
  EXPECT_THAT(session.Diagnosed({Of("x", FindingRole::kTargetCause)}, {}, traits),
              ElementsAre("x", "not_synchronous", "orientation_tag"));
  bundle.jitter.delta.clear();

  // A part of the points of one marker is rejected; one frame of the second camera is blurred.
  int index = 0;
  for (BundleObservation& seen : bundle.observations) {
    if (seen.camera == 0 && seen.marker == 33 && ++index % 2 == 0) seen.used = false;
    if (seen.camera == 1 && seen.frame == 4) {
      seen.seen.values[0] += 3 * std::sin(seen.seen.values[1] / 20);
    }
  }
  const std::vector<std::string> codes = session.Diagnosed();
  EXPECT_THAT(codes, IsSupersetOf({"marker_outlier", "frame_outlier"}));
  EXPECT_LT(std::ranges::find(codes, "marker_outlier"), std::ranges::find(codes, "frame_outlier"));
  for (const Finding& finding : session.record.findings) {
    EXPECT_THAT(finding.cameras, ElementsAre(finding.code == "marker_outlier" ? "cam0" : "cam1"));
  }
}

double MedianOf(const SyntheticProblem& problem, const char* model) {
  CameraInput camera = problem.input.cameras[0];
  SetModel(Model(model), &camera);
  return GuessCamera(camera, problem.input.markers).median_error;
}

TEST(LensCauses, NameTheModelOfFewestParametersThatFits) {
  const SyntheticProblem problem = Problem("pinhole");
  const std::vector<CameraModel> models{
      Model("pinhole-radtan8"), Model("pinhole-radial3"), Model("pinhole")};
  const double own = MedianOf(problem, "pinhole");
  const auto expect = [&](std::span<const CameraModel> tried, const char* best) {
    const std::optional<LensCause> found = FindLensCause(problem.input, 0, tried);
    ASSERT_TRUE(found);
    const double other = MedianOf(problem, best);
    const Finding& finding = found->finding;
    EXPECT_EQ(finding.code, "strong_distortion_pinhole");
    EXPECT_EQ(finding.role, FindingRole::kCause);
    EXPECT_EQ(finding.grade, Grade::kUsable);
    EXPECT_THAT(finding.cameras, ElementsAre(problem.input.cameras[0].name));
    EXPECT_EQ(finding.value, own);
    EXPECT_EQ(finding.limit, other);
    EXPECT_NEAR(found->residual, kSigmaPerMedianLength2d * other, 1e-12);
    EXPECT_EQ(finding.what,
              fmt::format("{}: pinhole does not describe this lens, which has distortion: median "
                          "residual {:.2g} px at the initial guess, {:.2g} px with {}.",
                          problem.input.cameras[0].name,
                          own,
                          other,
                          best));
    EXPECT_EQ(finding.remedy,
              fmt::format("Set model: {}, or compare models with 'plenocal try'.", best));
  };
  expect(models, "pinhole-radial3");
  expect(std::span(models).first(1), "pinhole-radtan8");
  EXPECT_FALSE(FindLensCause(problem.input, 0, {}));
  EXPECT_FALSE(FindLensCause(problem.input, 0, std::span(models).subspan(2, 1)));
}

TEST(LensCauses, AreOfModelsThatCanTakeItsPlace) {
  SyntheticProblem problem = Problem("pinhole");
  const std::vector<CameraModel> models{Model("pinhole-radial3")};
  std::vector<CameraModel> others = models;
  others[0].support_size = 1;
  EXPECT_FALSE(FindLensCause(problem.input, 0, others));
  others = models;
  others[0].self = others.data();
  EXPECT_FALSE(FindLensCause(problem.input, 0, others));
  others = {Model("focused-plenoptic")};
  EXPECT_FALSE(FindLensCause(problem.input, 0, others));
  // What the session fixes and states does not bind the others.
  problem.input.cameras[0].fixed[0] = true;
  problem.input.cameras[0].initial[0] = 1;
  EXPECT_TRUE(FindLensCause(problem.input, 0, models));
  SetModel(Model("pinhole-radial3"), &problem.input.cameras[0]);
  const CameraModel* const own = problem.input.cameras[0].model;
  EXPECT_FALSE(FindLensCause(problem.input, 0, {own, 1}));
}

// A fisheye, which has no view of a pinhole's kind.
TEST(LensCauses, HaveAnotherCodeForModelsWithDistortion) {
  SyntheticProblem problem = Problem("pinhole-radial3");
  CameraInput& camera = problem.input.cameras[0];
  const std::vector<double> params{350, 350, 640, 480, 0, 0, 0, 0};
  const CameraModel& fisheye = Model("kannala-brandt4");
  for (View& view : camera.views) {
    RigidTransform T = problem.T_rig_target.at(view.frame);
    T.t *= 0.2;
    std::erase_if(view.observations, [&](Observation& seen) {
      return !fisheye.Project(
          params.data(), nullptr, nullptr, T * problem.markers.at(seen.marker), seen.values.data());
    });
  }
  const std::vector<CameraModel> models{fisheye};
  SetModel(Model("pinhole-radial3"), &camera);
  const std::optional<LensCause> found = FindLensCause(problem.input, 0, models);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->finding.code, "model_misfit");
  EXPECT_EQ(found->finding.remedy,
            "Set model: kannala-brandt4, or compare models with 'plenocal try'.");
  EXPECT_THAT(found->finding.what,
              ::testing::StartsWith(
                  camera.name + ": pinhole-radial3 does not describe this lens: median residual "));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
