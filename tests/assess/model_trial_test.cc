// SPDX-License-Identifier: Apache-2.0
#include "assess/model_trial.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "calib/base/error.h"
#include "models/registry.h"
#include "tests/calib/synthetic.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

constexpr double kNoise = 0.1;  // px

std::vector<const CameraModel*> Models(const std::vector<std::string_view>& names) {
  std::vector<const CameraModel*> models;
  for (const std::string_view name : names) models.push_back(FindModel(CameraModels(), name));
  return models;
}

const ModelTrial& TrialOf(const ModelChoice& choice, std::string_view model) {
  return *std::ranges::find_if(choice.trials,
                               [&](const ModelTrial& trial) { return trial.model->name == model; });
}

TEST(TryModels, RanksByHeldOutFramesAndRecommendsTheTrueModel) {
  const SyntheticProblem problem = MakeProblem(5, {.frames = 20, .noise = kNoise});
  const ModelChoice choice =
      TryModels(problem.input, {0}, Models({"pinhole", "pinhole-radial3"}), {});
  ASSERT_EQ(choice.trials.size(), 2);
  EXPECT_EQ(choice.trials[choice.recommended].model->name, "pinhole-radial3");
  EXPECT_EQ(choice.folds, 5);
  EXPECT_EQ(choice.frames, 20);
  const ModelTrial &good = TrialOf(choice, "pinhole-radial3"), &poor = TrialOf(choice, "pinhole");
  EXPECT_EQ(good.free_parameters, 7);
  EXPECT_EQ(poor.free_parameters, 4);
  // The length of a residual of two coordinates is sqrt(2) times the noise of one, and a little
  // more of frames whose parameters were estimated without them.
  EXPECT_NEAR(good.rms, std::sqrt(2) * kNoise, 0.1 * kNoise);
  EXPECT_LE(good.in_sample_rms, good.rms);
  EXPECT_GT(poor.rms, 2 * good.rms);
  EXPECT_LT(poor.probability, 1e-3);
  EXPECT_EQ(good.probability, 1) << "the best is not worse than itself";
}

TEST(TryModels, ScoreEveryPointOnceWithTheSamePointsForAllModels) {
  SyntheticProblem problem = MakeProblem(6, {.frames = 10, .noise = kNoise});
  problem.input.cameras[0].views[3].observations[17].values[0] += 20;  // an outlier
  const ModelChoice choice =
      TryModels(problem.input, {0}, Models({"pinhole", "pinhole-radial3"}), {});
  EXPECT_EQ(choice.outliers, 1);
  size_t points = 0;
  for (const View& view : problem.input.cameras[0].views) points += view.observations.size();
  EXPECT_EQ(choice.points, points - 1);
  for (const ModelTrial& trial : choice.trials) {
    EXPECT_EQ(trial.held_out.size(), choice.points) << trial.model->name;
    double squares = 0;
    for (const HeldOutPoint& point : trial.held_out) {
      squares += std::pow(point.residual[0], 2) + std::pow(point.residual[1], 2);
    }
    EXPECT_NEAR(trial.rms, std::sqrt(squares / static_cast<double>(choice.points)), 1e-9);
  }
}

TEST(TryModels, PreferTheSimplerModelWhenBothExplainTheImages) {
  const SyntheticProblem problem =
      MakeProblem(7, {.frames = 12, .noise = kNoise, .distorted = false});
  const ModelChoice choice =
      TryModels(problem.input, {0}, Models({"pinhole-radial3", "pinhole"}), {});
  EXPECT_EQ(choice.trials[choice.recommended].model->name, "pinhole");
}

TEST(TryModels, APoorModelBesideThemChangesNothing) {
  const SyntheticProblem problem = MakeProblem(5, {.frames = 16, .noise = kNoise});
  const ModelChoice two =
      TryModels(problem.input, {0}, Models({"pinhole-radial3", "pinhole-radtan12"}), {});
  const ModelChoice three =
      TryModels(problem.input, {0}, Models({"pinhole", "pinhole-radial3", "pinhole-radtan12"}), {});
  EXPECT_EQ(two.trials[two.recommended].model, three.trials[three.recommended].model);
  EXPECT_EQ(two.noise, three.noise);
  for (const char* name : {"pinhole-radial3", "pinhole-radtan12"}) {
    const ModelTrial &a = TrialOf(two, name), &b = TrialOf(three, name);
    EXPECT_EQ(a.rms, b.rms) << name;
    EXPECT_EQ(a.rms_sigma, b.rms_sigma) << name;
    EXPECT_EQ(a.probability, b.probability) << name;
    EXPECT_EQ(a.difference, b.difference) << name;
    EXPECT_EQ(a.sigma, b.sigma) << name;
  }
}

TEST(TryModels, PreferTheCommonModelOfTwoThatAreEqual) {
  const SyntheticProblem problem =
      MakeProblem(7, {.frames = 12, .noise = kNoise, .distorted = false});
  // Both describe a lens without distortion; one parameter less does not make up for rare use.
  const ModelChoice choice =
      TryModels(problem.input, {0}, Models({"division", "pinhole-radial3"}), {});
  EXPECT_EQ(choice.trials[choice.recommended].model->name, "pinhole-radial3");
  EXPECT_LT(TrialOf(choice, "division").free_parameters,
            TrialOf(choice, "pinhole-radial3").free_parameters);
}

TEST(TryModels, PreferOpenCvsFiveCoefficientsUnlessOthersPredictBetter) {
  for (const bool distorted : {false, true}) {
    const SyntheticProblem problem =
        MakeProblem(7, {.frames = 12, .noise = kNoise, .distorted = distorted});
    const ModelChoice choice = TryModels(
        problem.input, {0}, Models({"pinhole-radial3", "pinhole-radtan", "kannala-brandt4"}), {});
    EXPECT_EQ(choice.trials[choice.recommended].model->name, "pinhole-radtan");
  }
}

TEST(TryModels, ChooseTheSameAmongMoreCandidates) {
  for (const unsigned seed : {11U, 12U}) {
    SyntheticProblem problem = MakeProblem(seed, {.frames = 8, .noise = kNoise});
    problem.input.cameras[0].views[2].observations[5].values[0] += 3;
    std::vector<const CameraModel*> models = Models({"pinhole-radtan", "kannala-brandt4"});
    const ModelChoice common = TryModels(problem.input, {0}, models, {});
    for (const CameraModel* rare : Models({"division", "fov", "ucm", "eucm"})) {
      models.push_back(rare);
    }
    const ModelChoice all = TryModels(problem.input, {0}, models, {});
    const ModelTrial &a = common.trials[common.recommended], &b = all.trials[all.recommended];
    EXPECT_EQ(a.model, b.model);
    EXPECT_EQ(a.rms, b.rms) << "the same outliers";
  }
}

TEST(TryModels, LeaveNoParameterOpenForNothing) {
  // Terms of high order that few noisy images leave open; the projection's sigma is no larger.
  const SyntheticProblem problem = MakeProblem(3, {.frames = 6, .noise = 3 * kNoise});
  const ModelChoice choice =
      TryModels(problem.input, {0}, Models({"pinhole-radial3", "kannala-brandt4"}), {});
  EXPECT_EQ(choice.trials[choice.recommended].model->name, "pinhole-radial3");
  const ModelTrial& open = TrialOf(choice, "kannala-brandt4");
  EXPECT_FALSE(open.undetermined.empty());
  EXPECT_LT(open.sigma, TrialOf(choice, "pinhole-radial3").sigma);
  EXPECT_TRUE(open.outweighed_by);
  EXPECT_GT(open.gain, 0);
  EXPECT_LT(open.gain, kNoise) << "what the held-out frames gain by it, px";
}

TEST(TryModelsAndTarget, ChooseTheTargetBeforeTheLastTrialOfTheModels) {
  constexpr double kTolerance = 1e-3;  // m
  for (const double bent : {0.0, kTolerance}) {
    SyntheticProblem problem =
        MakeProblem(8, {.frames = 16, .noise = kNoise, .marker_tolerance = bent});
    problem.input.marker_freedom = MarkerFreedom::Rigid();
    const ModelAndTarget tried = TryModelsAndTarget(problem.input,
                                                    {0},
                                                    Models({"pinhole-radial3", "ucm"}),
                                                    MarkerFreedom::FromSigma(kTolerance),
                                                    TargetQuestion::kChoose,
                                                    {});
    EXPECT_EQ(tried.targets.trials[tried.targets.recommended].marker_freedom.Sigma(), bent);
    ASSERT_EQ(tried.models.trials.size(), 2U);
    EXPECT_EQ(tried.models.trials[0].marker_freedom.Sigma(), bent);
    EXPECT_EQ(tried.models.trials[tried.models.recommended].model->name, "pinhole-radial3");
  }
}

TEST(TryModels, MeasureTheDifferenceToTheReferenceInPixels) {
  const SyntheticProblem problem = MakeProblem(5, {.frames = 16, .noise = kNoise});
  const ModelChoice choice =
      TryModels(problem.input, {0}, Models({"pinhole", "pinhole-radial3", "pinhole-radtan12"}), {});
  EXPECT_EQ(choice.trials[choice.reference].difference, 0);
  EXPECT_NEAR(choice.noise, std::sqrt(2) * kNoise, 0.1 * kNoise);
  const ModelTrial &rich = TrialOf(choice, "pinhole-radtan12"), &poor = TrialOf(choice, "pinhole");
  EXPECT_LT(rich.difference, poor.difference);
  EXPECT_GT(poor.difference, choice.noise);
  EXPECT_FALSE(poor.practically_equal);
  // Five coefficients that describe nothing cost more than they gain.
  ASSERT_TRUE(rich.outweighed_by);
  EXPECT_EQ(choice.trials[*rich.outweighed_by].model->name, "pinhole-radial3");
  EXPECT_LT(rich.gain, rich.sigma);
}

TEST(TryTargets, FindsWhetherTheBoardIsAsDescribed) {
  constexpr double kTolerance = 1e-3;  // m
  for (const double bent : {0.0, kTolerance}) {
    SyntheticProblem problem =
        MakeProblem(8, {.frames = 16, .noise = kNoise, .marker_tolerance = bent});
    problem.input.marker_freedom = {};  // what the session states does not matter
    const ModelChoice choice =
        TryTargets(problem.input, {0}, MarkerFreedom::FromSigma(kTolerance), {});
    ASSERT_EQ(choice.trials.size(), 2);
    EXPECT_EQ(choice.trials[choice.recommended].marker_freedom.Sigma(), bent);
    const ModelTrial& held = choice.trials[choice.trials[0].marker_freedom.IsRigid() ? 0 : 1];
    if (bent > 0) {
      EXPECT_GT(held.difference, choice.noise / 3);
    }
  }
}

// An error that all points of the camera share, as the cube of the radius, which no pose absorbs: a
// frame that was held out is judged with the size that the others gave.
TEST(TryModels, HeldOutPointsHaveTheErrorThatTheirCameraShares) {
  SyntheticProblem problem = MakeProblem(7, {.frames = 12, .noise = kNoise, .distorted = false});
  for (View& view : problem.input.cameras[0].views) {
    for (Observation& seen : view.observations) {
      const Eigen::Vector2d x(seen.values[0] - problem.params[0][2],
                              seen.values[1] - problem.params[0][3]);
      const Eigen::Vector2d moved = 2 * kNoise * (x / 100) * (x / 100).squaredNorm();
      seen.values[0] += moved.x();
      seen.values[1] += moved.y();
      view.by_nuisance.push_back({moved.x(), moved.y()});
    }
  }
  const ModelChoice choice = TryModels(problem.input, {0}, Models({"pinhole"}), {});
  ASSERT_EQ(choice.trials.size(), 1);
  EXPECT_NEAR(choice.trials[0].rms, std::sqrt(2) * kNoise, 0.1 * kNoise);
}

TEST(TryModels, NeedFramesToHoldOut) {
  const SyntheticProblem problem = MakeProblem(5, {.frames = 2, .noise = kNoise});
  EXPECT_THAT(
      RefusalOf([&] { TryModels(problem.input, {0}, Models({"pinhole"}), {}); }, ErrorKind::kJob),
      HasSubstr("2 frames: too few"));
}

// The second camera has seen every fifth frame alone: those are one fold.
TEST(TryModels, NeedFramesOfTheCameraInTwoFolds) {
  SyntheticProblem problem = MakeProblem(5, {.cameras = 2, .frames = 20, .noise = kNoise});
  std::vector<View>& views = problem.input.cameras[1].views;
  std::vector<std::string> frames;
  for (const View& view : problem.input.cameras[0].views) frames.push_back(view.frame);
  std::ranges::sort(frames);
  std::erase_if(views, [&](const View& view) {
    return (std::ranges::find(frames, view.frame) - frames.begin()) % 5 != 0;
  });
  ASSERT_EQ(views.size(), 4U);
  EXPECT_THAT(RefusalOf([&] { TryModels(problem.input, {1}, Models({"pinhole-radial3"}), {}); },
                        ErrorKind::kJob),
              HasSubstr("pinhole-radial3: without fold 1: cam1 has no observations left"));
}

TEST(TryModels, StopWhenTheCallerAsks) {
  const SyntheticProblem problem = MakeProblem(5, {.frames = 8, .noise = kNoise});
  TrialOptions options;
  options.progress = [](const std::string&, size_t, size_t) { return false; };
  EXPECT_THROW(TryModels(problem.input, {0}, Models({"pinhole"}), options), Stopped);
}

TEST(OfOneKind, AreModelsWithTheSameMeasurement) {
  const auto models = Models({"pinhole", "pinhole-radial3", "focused-plenoptic"});
  EXPECT_TRUE(OfOneKind(*models[0], *models[1]));
  EXPECT_FALSE(OfOneKind(*models[0], *models[2]));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
