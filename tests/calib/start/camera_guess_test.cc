// SPDX-License-Identifier: Apache-2.0
//
// Initial guesses, with models whose starts the tests choose.
#include "calib/start/camera_guess.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::SizeIs;

enum : size_t { kFx, kFy, kCx, kCy, kA0, kA1, kA2, kParams };

// What a model's functions get from a test, and what they were asked.
struct Asked {
  std::vector<std::vector<double>> starts;
  std::vector<std::vector<std::optional<double>>> given;  // a call
  std::vector<View> views;                                // of the first call
  std::string refusal;
  Misfit misfit;
} asked;

std::vector<StartCandidate> GivenStarts(const CameraModel& /*model*/, const StartProblem& problem) {
  if (asked.given.empty()) asked.views.assign(problem.views.begin(), problem.views.end());
  asked.given.emplace_back(problem.given.begin(), problem.given.end());
  std::vector<StartCandidate> candidates;
  for (const std::vector<double>& params : asked.starts) candidates.push_back({params});
  return candidates;
}
std::string GivenRefusal(const CameraModel& /*model*/, const StartProblem& /*problem*/) {
  return asked.refusal;
}
Misfit GivenMisfit(const CameraModel& /*model*/,
                   const StartProblem& /*problem*/,
                   std::span<const double> /*params*/,
                   double /*median_error*/) {
  return asked.misfit;
}

class CameraGuessTest : public ::testing::Test {
 protected:
  explicit CameraGuessTest(const SyntheticOptions& options = {.frames = 15})
      : problem_(MakeProblem(4, options)), camera_(problem_.input.cameras[0]) {
    model_ = *camera_.model;
    model_.functions.start = GivenStarts;
    model_.functions.refusal = GivenRefusal;
    model_.functions.misfit = GivenMisfit;
    camera_.model = &model_;
    asked = {.starts = {problem_.params[0]}, .given = {}, .views = {}, .refusal = {}, .misfit = {}};
  }

  // The true parameters with other focal lengths.
  [[nodiscard]] std::vector<double> WithFocalLengths(double f_x, double f_y) const {
    std::vector<double> params = problem_.params[0];
    params[kFx] = f_x;
    params[kFy] = f_y;
    return params;
  }
  CameraGuess Guess(MarkerFreedom freedom = {}) const {
    return GuessCamera(camera_, problem_.input.markers, freedom);
  }
  void AddNoise(double sigma) {
    Random random(1);
    for (View& view : camera_.views) {
      for (Observation& seen : view.observations) {
        for (size_t i = 0; i < 2; ++i) seen.values[i] += random.Gaussian(sigma);
      }
    }
  }

  SyntheticProblem problem_;
  CameraInput& camera_;
  CameraModel model_;
};

TEST_F(CameraGuessTest, OfExactViewsIsTheCamera) {
  asked.starts = {WithFocalLengths(900, 950)};
  const CameraGuess guess = Guess();
  for (size_t k = 0; k < kParams; ++k) {
    EXPECT_NEAR(guess.params[k], problem_.params[0][k], 1e-3 * std::abs(problem_.params[0][k]));
  }
  EXPECT_LT(guess.median_error, 0.01);
  EXPECT_EQ(guess.misfit, "");
  ASSERT_EQ(guess.T_camera_target.size(), camera_.views.size());
  for (size_t v = 0; v < camera_.views.size(); ++v) {
    ASSERT_TRUE(guess.T_camera_target[v]) << v;
    const RigidTransform& truth = problem_.T_rig_target.at(camera_.views[v].frame);
    EXPECT_LT((guess.T_camera_target[v]->t - truth.t).norm(), 1e-3 * truth.t.norm()) << v;
    EXPECT_LT((guess.T_camera_target[v]->R - truth.R).norm(), 1e-3) << v;
  }
}

TEST_F(CameraGuessTest, ViewsOfFewerThanFourKnownMarkersHaveNoPose) {
  camera_.views[3].observations.resize(3);
  std::erase_if(camera_.views[5].observations, [](const Observation& seen) {
    return seen.marker != 22 && seen.marker != 27 && seen.marker != 42 && seen.marker != 47;
  });
  ASSERT_EQ(camera_.views[5].observations.size(), 4);
  camera_.views[6].observations.resize(5);
  for (size_t i = 0; i < 2; ++i) camera_.views[6].observations[i].marker = 900;  // of no target
  const CameraGuess guess = Guess();
  for (size_t v = 0; v < camera_.views.size(); ++v) {
    EXPECT_EQ(guess.T_camera_target[v].has_value(), v != 3 && v != 6) << v;
  }
  for (View& view : camera_.views) view.observations.resize(3);
  EXPECT_EQ(RefusalOf([&] { Guess(); }, ErrorKind::kJob),
            "cam0: no image shows 4 or more markers of the target; nothing to start from");
}

// The focal lengths are held, so that the starts differ in the residuals that they leave.
TEST_F(CameraGuessTest, IsTheStartThatExplainsTheViewsBest) {
  camera_.fixed[kFx] = camera_.fixed[kFy] = true;
  const double f_x = problem_.params[0][kFx], f_y = problem_.params[0][kFy];
  const std::vector<double> best = WithFocalLengths(f_x, f_y),
                            other = WithFocalLengths(1.3 * f_x, 1.3 * f_y),
                            third = WithFocalLengths(0.7 * f_x, 0.7 * f_y);
  for (const auto& starts :
       {std::vector{best, other, third}, {other, best, third}, {third, other, best}}) {
    asked.starts = starts;
    EXPECT_EQ(Guess().params[kFx], f_x);
  }
  // Where distortion, at first, makes a wrong focal length look better.
  std::vector<double> bent = best;
  bent[kA0] -= 0.5;
  asked.starts = {bent, other};
  const CameraGuess guess = Guess();
  EXPECT_EQ(guess.params[kFx], f_x);
  EXPECT_NEAR(guess.params[kA0], problem_.params[0][kA0], 1e-3);
}

TEST_F(CameraGuessTest, ObeysBoundsAndTies) {
  const double f_x = problem_.params[0][kFx], f_y = problem_.params[0][kFy];
  camera_.fixed.assign(kParams, true);
  camera_.rules.resize(kParams);
  camera_.rules[kFy].tied_to = ParamIndex{0, kFx};
  camera_.rules[kCx].upper = problem_.params[0][kCx] - 0.5;
  camera_.rules[kCy].lower = problem_.params[0][kCy] + 0.25;
  const CameraGuess guess = Guess();
  EXPECT_DOUBLE_EQ(guess.params[kFx], (f_x + f_y) / 2);
  EXPECT_EQ(guess.params[kFy], guess.params[kFx]);
  EXPECT_EQ(guess.params[kCx], camera_.rules[kCx].upper);
  EXPECT_EQ(guess.params[kCy], camera_.rules[kCy].lower);
  EXPECT_EQ(guess.params[kA0], problem_.params[0][kA0]);
}

// A user's value, else a prior's within the bounds.
TEST_F(CameraGuessTest, StartsFromValuesThatAreStated) {
  camera_.rules.resize(kParams);
  camera_.initial[kFx] = 1000;
  camera_.rules[kFx].prior = ParamRule::Prior{1100, 10};
  camera_.rules[kFy].prior = ParamRule::Prior{1110, 10};
  camera_.rules[kCx].prior = ParamRule::Prior{700, 10};
  camera_.rules[kCx].upper = 650;
  Guess();
  EXPECT_THAT(asked.given.at(0),
              ElementsAre(1000, 1110, 650, std::nullopt, std::nullopt, std::nullopt, std::nullopt));
}

// A residual of several pixels may be that of a wrong minimum.
TEST_F(CameraGuessTest, OfLargeResidualsIsTriedWithoutDistortionAndJudged) {
  AddNoise(3);
  asked.misfit.reason = "does not suit";
  const CameraGuess guess = Guess();
  EXPECT_EQ(guess.misfit, "cam0: pinhole-radial3 does not suit");
  // The median of a length of two coordinates.
  EXPECT_NEAR(guess.median_error, 3 * 1.18, 0.5);
  ASSERT_EQ(asked.given.size(), 2);
  EXPECT_THAT(asked.given[0], Each(std::nullopt));
  EXPECT_THAT(asked.given[1],
              ElementsAre(std::nullopt, std::nullopt, std::nullopt, std::nullopt, 0, 0, 0));
  asked.misfit.impossible = true;
  EXPECT_EQ(RefusalOf([&] { Guess(); }, ErrorKind::kJob),
            "cam0: pinhole-radial3 does not suit (model_misfit)");
  // Markers that are off by so much explain it: 3 px in 0.6 m.
  asked.given.clear();
  EXPECT_EQ(Guess(MarkerFreedom::FromSigma(0.005)).misfit, "");
  EXPECT_THAT(asked.given, SizeIs(1));
  EXPECT_NE(RefusalOf([&] { Guess(MarkerFreedom::FromSigma(0.0005)); }, ErrorKind::kJob), "");
}

TEST_F(CameraGuessTest, IsRefusedAsTheModelDoesAndWithoutStarts) {
  asked.starts.clear();
  EXPECT_EQ(RefusalOf([&] { Guess(); }, ErrorKind::kJob),
            "cam0: no initial guess of model pinhole-radial3 explains the detections; does the "
            "target file describe the target in the images, and does the model suit the lens?");
  asked.refusal = "needs a wall";
  EXPECT_EQ(RefusalOf([&] { Guess(); }), "cam0: pinhole-radial3: needs a wall");
}

class ManyViews : public CameraGuessTest {
 protected:
  ManyViews() : CameraGuessTest({.frames = 20}) {}

  [[nodiscard]] std::vector<size_t> Chosen() const {
    std::vector<size_t> chosen;
    for (const View& view : asked.views) chosen.push_back(std::stoul(view.frame));
    return chosen;
  }
  void Shorten(size_t view, size_t count) { camera_.views[view].observations.resize(count); }
};

TEST_F(ManyViews, TwelveRichOnesServe) {
  ASSERT_EQ(camera_.views.size(), 20);
  for (const View& view : camera_.views) ASSERT_GE(view.observations.size(), 45);
  Guess();
  EXPECT_THAT(Chosen(), ElementsAre(0, 1, 3, 5, 6, 8, 10, 11, 13, 15, 16, 18));
  EXPECT_THAT(asked.views, Each(::testing::Field(&View::observations, SizeIs(40))));
  // Fewer than half of the most: not of the rich ones.
  asked.given.clear();
  for (const size_t poor : {0, 3, 6, 10, 13}) Shorten(poor, 10);
  Guess();
  EXPECT_THAT(Chosen(), ElementsAre(1, 2, 4, 5, 8, 9, 11, 12, 15, 16, 17, 18));
}

TEST_F(ManyViews, OfFewRichOnesTheRichestOfTheOthersServeToo) {
  for (size_t v = 0; v < camera_.views.size(); ++v) Shorten(v, v % 3 == 0 ? 45 : 5 + v % 10);
  Guess();  // seven rich ones; of the others those of 12 and more points, and the first of 11
  EXPECT_THAT(Chosen(), ElementsAre(0, 3, 6, 7, 8, 9, 12, 15, 16, 17, 18, 19));
}

TEST_F(ManyViews, MarkersAreSpreadOverTheView) {
  ASSERT_EQ(camera_.views[0].observations.size(), 70);
  Guess();
  std::vector<int> expected;
  for (int i = 0; i < 40; ++i) expected.push_back(i * 70 / 40);
  std::vector<int> markers;
  for (const Observation& seen : asked.views[0].observations) markers.push_back(seen.marker);
  EXPECT_EQ(markers, expected);
}

TEST_F(CameraGuessTest, CameraHoldsWhatItsModelFixesAndWhatOthersGive) {
  std::vector<Param> params(model_.params.begin(), model_.params.end());
  params[kCx].fixed = Fixed::kAgainstPoses;
  params[kFy].by_others = [](const double* values) { return 2 * values[kFx]; };
  params[kA1].prior_sigma = 0.125;
  params[kA2].prior_sigma = 0.25;
  model_.params = params;
  camera_.fixed[kA0] = true;
  camera_.rules.resize(kParams);
  camera_.rules[kA2].prior = ParamRule::Prior{0.5, 0.0625};
  const std::vector<double>& values = problem_.params[0];
  BundleState state;
  state.cameras.push_back(MakeBundleCamera(camera_, values));
  const BundleCamera& made = state.cameras[0];
  EXPECT_EQ(made.name, "cam0");
  EXPECT_THAT(made.fixed, ElementsAre(false, true, true, false, true, false, false));
  EXPECT_EQ(made.params[kFy], kByOthers);
  EXPECT_EQ(made.params[kFx], values[kFx]);
  EXPECT_EQ(made.rules[kA1].prior->value, 0);
  EXPECT_EQ(made.rules[kA1].prior->sigma, 0.125);
  EXPECT_EQ(made.rules[kA2].prior->value, 0.5);
  EXPECT_EQ(made.rules[kA2].prior->sigma, 0.0625);
  EXPECT_FALSE(made.rules[kFx].prior);
  SetByOthers(&state);
  EXPECT_EQ(state.cameras[0].params[kFy], 2 * values[kFx]);
  EXPECT_EQ(state.cameras[0].params[kCx], values[kCx]);
  // A value that is stated is estimated, and so is one with a prior.
  camera_.initial[kFy] = 1000;
  EXPECT_FALSE(MakeBundleCamera(camera_, values).fixed[kFy]);
  camera_.initial[kFy].reset();
  camera_.rules[kFy].prior = ParamRule::Prior{1000, 10};
  EXPECT_FALSE(MakeBundleCamera(camera_, values).fixed[kFy]);
  // What is tied has the prior of the other.
  camera_.rules[kA1].tied_to = ParamIndex{0, kA2};
  EXPECT_FALSE(MakeBundleCamera(camera_, values).rules[kA1].prior);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
