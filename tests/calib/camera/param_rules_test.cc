// SPDX-License-Identifier: Apache-2.0
//
// Priors, bounds, and parameters that are one with others.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "calib/estimate/calibrate.h"
#include "calib/estimate/weak_unknowns.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::MakeProblem;
using testing::SyntheticProblem;

constexpr double kNoise = 0.1;
enum Parameter { kFx, kFy, kCx, kCy, kA0, kA1, kA2 };

// The problem with other true parameters: what the cameras then see, with noise.
void SeeAgain(SyntheticProblem* problem, unsigned seed) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> noise(0, kNoise);
  for (size_t c = 0; c < problem->params.size(); ++c) {
    CameraInput& camera = problem->input.cameras[c];
    for (View& view : camera.views) {
      const RigidTransform T = problem->T_camera_rig[c] * problem->T_rig_target.at(view.frame);
      for (Observation& seen : view.observations) {
        const double values[kMaxObservationSize] = {};
        ASSERT_TRUE(camera.model->Project(problem->params[c].data(),
                                          nullptr,
                                          values,
                                          T * problem->markers.at(seen.marker),
                                          seen.values.data()));
        for (size_t r = 0; r < 2; ++r) seen.values[r] += noise(engine);
      }
    }
  }
}

CameraInput& Ruled(SyntheticProblem* problem, size_t camera = 0) {
  for (CameraInput& each : problem->input.cameras) each.rules.resize(each.model->params.size());
  return problem->input.cameras[camera];
}

TEST(Prior, CountsLikeOneMoreMeasurement) {
  SyntheticProblem problem = MakeProblem(11, {.cameras = 1, .frames = 6, .noise = kNoise});
  const Calibration without = Calibrate(problem.input, {});
  const double value = without.bundle.cameras[0].params[kFx];
  const double sigma = without.uncertainty.param_std_errors[0][kFx];
  // As good as the images, and two sigmas away: the estimate stands in the middle.
  Ruled(&problem).rules[kFx].prior = {value + 2 * sigma, sigma};
  const Calibration with = Calibrate(problem.input, {});
  EXPECT_NEAR(with.bundle.cameras[0].params[kFx], value + sigma, 0.1 * sigma);
  EXPECT_NEAR(with.uncertainty.param_std_errors[0][kFx], sigma / std::sqrt(2.0), 0.03 * sigma);
  // What correlates with it is known better too.
  EXPECT_LT(with.uncertainty.param_std_errors[0][kFy],
            0.9 * without.uncertainty.param_std_errors[0][kFy]);
  // Half of the parameter is the prior's, so the data have half a coordinate more to spare.
  EXPECT_NEAR(with.uncertainty.redundancy[0] - without.uncertainty.redundancy[0], 0.5, 0.05);
  EXPECT_TRUE(with.findings.empty());

  Ruled(&problem).rules[kFx].prior = {value + 10 * sigma, sigma};
  EXPECT_THAT(testing::CodesOf(Calibrate(problem.input, {}).findings),
              ElementsAre("prior_contradicted"));
}

TEST(Prior, DeterminesWhatTheImagesDoNot) {
  SyntheticProblem problem = MakeProblem(11, {.cameras = 1, .frames = 6, .noise = kNoise});
  // From one pose the focal length is open.
  for (View& view : problem.input.cameras[0].views) {
    const std::string frame = view.frame;
    view = problem.input.cameras[0].views[0];
    view.frame = frame;
  }
  EXPECT_TRUE(std::isinf(Calibrate(problem.input, {}).uncertainty.param_std_errors[0][kFx]));
  CameraInput& camera = Ruled(&problem);
  for (const Parameter parameter : {kFx, kFy, kCx, kCy, kA0, kA1, kA2}) {
    const double value = problem.params[0][parameter];
    camera.rules[parameter].prior = {value, 1e-3 * std::max(1.0, std::abs(value))};
  }
  const Calibration calibration = Calibrate(problem.input, {});
  EXPECT_NEAR(calibration.bundle.cameras[0].params[kFx], problem.params[0][kFx], 5e-3 * 1000);
  EXPECT_LE(calibration.uncertainty.param_std_errors[0][kFx], 1.001e-3 * problem.params[0][kFx]);
}

TEST(Prior, LeavesErrorsAsLargeAsTheirSigmas) {
  // 30 problems of 7 parameters, correlated within a problem: 210 squares have a standard deviation
  // of 0.1 about 1 if independent; three times twice that.
  double sum = 0;
  int count = 0;
  std::mt19937 engine(2);
  std::normal_distribution<double> normal(0, 1);
  for (unsigned seed = 0; seed < 30; ++seed) {
    SyntheticProblem problem =
        MakeProblem(300 + seed, {.cameras = 1, .frames = 5, .noise = kNoise});
    const Calibration without = Calibrate(problem.input, {});
    for (const Parameter parameter : {kFx, kA1}) {
      const double sigma = 0.5 * without.uncertainty.param_std_errors[0][parameter];
      Ruled(&problem).rules[parameter].prior = {
          problem.params[0][parameter] + sigma * normal(engine), sigma};
    }
    const Calibration with = Calibrate(problem.input, {});
    for (const Parameter parameter : {kFx, kFy, kCx, kCy, kA0, kA1, kA2}) {
      const double sigma = with.uncertainty.param_std_errors[0][parameter];
      sum += std::pow(
          (with.bundle.cameras[0].params[parameter] - problem.params[0][parameter]) / sigma, 2);
      ++count;
    }
  }
  EXPECT_NEAR(sum / count, 1, 0.6);
}

TEST(Bounds, HoldWhatWouldLeaveThemAndNothingElse) {
  SyntheticProblem problem = MakeProblem(12, {.cameras = 1, .frames = 10, .noise = kNoise});
  const Calibration free = Calibrate(problem.input, {});
  const std::vector<double>& params = free.bundle.cameras[0].params;

  Ruled(&problem).rules[kA0].lower = params[kA0] - 0.1;
  Ruled(&problem).rules[kA0].upper = params[kA0] + 0.1;
  const Calibration wide = Calibrate(problem.input, {});
  EXPECT_NEAR(wide.bundle.cameras[0].params[kFx], params[kFx], 1e-3);
  EXPECT_GT(wide.uncertainty.param_std_errors[0][kA0], 0);
  EXPECT_TRUE(wide.findings.empty());

  const double bound = params[kA0] + 5 * free.uncertainty.param_std_errors[0][kA0];
  Ruled(&problem).rules[kA0].lower = bound;
  const Calibration narrow = Calibrate(problem.input, {});
  EXPECT_EQ(narrow.bundle.cameras[0].params[kA0], bound);
  EXPECT_EQ(narrow.uncertainty.param_std_errors[0][kA0], 0);
  EXPECT_EQ(narrow.uncertainty.param_index[0][kA0], -1);
  EXPECT_THAT(testing::CodesOf(narrow.findings), ElementsAre("at_bound"));

  // The rest is as if the parameter were held there.
  Ruled(&problem).rules.clear();
  problem.input.cameras[0].initial[kA0] = bound;
  problem.input.cameras[0].fixed[kA0] = true;
  const Calibration held = Calibrate(problem.input, {});
  for (const Parameter parameter : {kFx, kFy, kCx, kCy, kA1, kA2}) {
    const double sigma = held.uncertainty.param_std_errors[0][parameter];
    EXPECT_NEAR(narrow.bundle.cameras[0].params[parameter],
                held.bundle.cameras[0].params[parameter],
                0.01 * sigma);
    EXPECT_NEAR(narrow.uncertainty.param_std_errors[0][parameter], sigma, 0.01 * sigma);
  }
}

TEST(Bounds, AreGivenUpWhereTheOptimumLiesInside) {
  SyntheticProblem problem = MakeProblem(12, {.cameras = 1, .frames = 10, .noise = kNoise});
  const Calibration free = Calibrate(problem.input, {});
  const std::vector<double>& params = free.bundle.cameras[0].params;
  // Starts at the far end of the bounds, and on the way one parameter meets another's bound.
  CameraInput& camera = Ruled(&problem);
  camera.rules[kFx].lower = params[kFx] - 0.01;
  camera.rules[kFx].upper = params[kFx] + 100;
  camera.rules[kCx].lower = params[kCx] - 0.01;
  camera.rules[kCx].upper = params[kCx] + 30;
  camera.initial[kFx] = params[kFx] + 100;
  camera.initial[kCx] = params[kCx] + 30;
  const Calibration calibration = Calibrate(problem.input, {});
  // Each solve comes to a hundredth of a sigma of the optimum.
  for (const Parameter k : {kFx, kCx}) {
    EXPECT_GT(free.uncertainty.param_std_errors[0][k], 0);
    EXPECT_NEAR(calibration.bundle.cameras[0].params[k],
                params[k],
                0.02 * free.uncertainty.param_std_errors[0][k]);
    EXPECT_NEAR(
        calibration.uncertainty.param_std_errors[0][k] / free.uncertainty.param_std_errors[0][k],
        1,
        0.01);
  }
}

TEST(ParametersThatAreOne, HaveOneValueAndOneSigma) {
  double squares = 0;
  int count = 0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    SyntheticProblem problem = MakeProblem(60 + seed, {.cameras = 2, .frames = 6, .noise = kNoise});
    problem.params[0][kFy] = problem.params[0][kFx];
    problem.params[1][kFx] = problem.params[0][kFx];
    SeeAgain(&problem, seed);
    const Calibration apart = Calibrate(problem.input, {});
    Ruled(&problem, 0).rules[kFy].tied_to = {0, kFx};
    Ruled(&problem, 1).rules[kFx].tied_to = {0, kFx};
    const Calibration one = Calibrate(problem.input, {});
    const auto& cameras = one.bundle.cameras;
    const auto& uncertainty = one.uncertainty;
    EXPECT_EQ(cameras[0].params[kFy], cameras[0].params[kFx]);
    EXPECT_EQ(cameras[1].params[kFx], cameras[0].params[kFx]);
    const double sigma = uncertainty.param_std_errors[0][kFx];
    EXPECT_EQ(uncertainty.param_std_errors[0][kFy], sigma);
    EXPECT_EQ(uncertainty.param_std_errors[1][kFx], sigma);
    EXPECT_EQ(uncertainty.param_index[1][kFx], uncertainty.param_index[0][kFx]);
    EXPECT_EQ(uncertainty.names.size(), apart.uncertainty.names.size() - 2);
    EXPECT_LT(sigma, apart.uncertainty.param_std_errors[0][kFx]);
    EXPECT_LT(sigma, apart.uncertainty.param_std_errors[1][kFx]);
    for (size_t c = 0; c < 2; ++c) {
      for (const Parameter parameter : {kFx, kFy, kCx, kCy, kA0, kA1, kA2}) {
        squares += std::pow((cameras[c].params[parameter] - problem.params[c][parameter]) /
                                uncertainty.param_std_errors[c][parameter],
                            2);
        ++count;
      }
    }
  }
  EXPECT_NEAR(squares / count, 1, 0.5);  // as in Prior.LeavesErrorsAsLargeAsTheirSigmas
}

TEST(ParametersThatAreOne, AreNamedOnceWhereTheyAreOpen) {
  SyntheticProblem problem = MakeProblem(11, {.cameras = 1, .frames = 1, .noise = kNoise});
  Ruled(&problem).rules[kFy].tied_to = {0, kFx};
  const Calibration calibration = Calibrate(problem.input, {});
  int named = 0;
  for (const WeakUnknowns& weak : testing::WeakUnknownsOf(calibration)) {
    for (const std::string& name : weak.names) named += name.ends_with(".f_x") ? 1 : 0;
    EXPECT_THAT(weak.names, ::testing::Not(::testing::Contains(::testing::EndsWith(".f_y"))));
  }
  EXPECT_LE(named, 1);
}

}  // namespace TEST_FILE
}  // namespace plenocal
