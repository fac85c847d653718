// SPDX-License-Identifier: Apache-2.0
//
// Stress tests: of cameras that have their model none fails; the others fail where they differ.
#include "assess/stress/stress.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <vector>

#include "calib/base/statistics.h"
#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::Each;
using ::testing::Field;
using ::testing::HasSubstr;

constexpr double kNoise = 0.1;  // px

SyntheticProblem Problem(unsigned seed) {
  return MakeProblem(seed, {.frames = 20, .noise = kNoise});
}

std::vector<StressTest> Stress(const SyntheticProblem& problem) {
  const std::vector<size_t> cameras{0};
  return TestStress(Calibrate(problem.input, {}),
                    cameras,
                    {.loss = problem.input.loss, .go_on = [] { return true; }});
}

std::set<std::string> Failing(const std::vector<StressTest>& tests) {
  std::set<std::string> failing;
  for (const StressTest& test : tests) {
    if (test.Fails()) failing.insert(test.what);
  }
  return failing;
}

// Images of the problem's poses by a lens of another model.
void ImageBy(const CameraModel& model,
             const std::vector<double>& params,
             SyntheticProblem* problem) {
  Random random(1);
  for (View& view : problem->input.cameras[0].views) {
    for (Observation& seen : view.observations) {
      const Eigen::Vector3d p =
          problem->T_rig_target.at(view.frame) * problem->markers.at(seen.marker);
      EXPECT_TRUE(model.Project(params.data(), nullptr, nullptr, p, seen.values.data()));
      for (size_t k = 0; k < 2; ++k) seen.values[k] += random.Gaussian(kNoise);
    }
  }
}

// A problem whose lens has a part more than its model, of these numbers.
SyntheticProblem WithPart(const std::string& part, const std::vector<double>& numbers) {
  SyntheticProblem problem = Problem(1);
  std::vector<double> params = problem.params[0];
  params.insert(params.end(), numbers.begin(), numbers.end());
  ImageBy(*FindModel(CameraModels(), "pinhole-radial3+" + part), params, &problem);
  return problem;
}

TEST(StressTests, OfACameraThatHasItsModelAgree) {
  int alarms = 0;
  constexpr int kCameras = 8;
  for (unsigned seed = 0; seed < kCameras; ++seed) {
    const std::vector<StressTest> tests = Stress(Problem(seed));
    EXPECT_EQ(tests.size(), 8u);
    alarms += Failing(tests).empty() ? 0 : 1;
    for (const StressTest& test : tests) {
      EXPECT_EQ(test.failure, "") << test.what;
      // Predictions of half a dozen parameters: within a factor.
      EXPECT_LT(test.difference, 3 * test.predicted) << test.what;
      EXPECT_GT(test.difference, 0.1 * test.predicted) << test.what;
      EXPECT_GT(test.factor, 0.95) << test.what;
    }
  }
  EXPECT_LE(alarms, 2);  // 0.4 expected
}

TEST(StressTests, APupilThatMovesMakesNearAndFarFramesDiffer) {
  const std::vector<StressTest> tests = Stress(WithPart("pupil", {0.1, 0, 0}));
  EXPECT_THAT(Failing(tests), Contains("near/far"));
  EXPECT_THAT(StressReading(tests), HasSubstr("near and far frames differ: "));
}

TEST(StressTests, AModelThatIsTooStiffDiffersInRegions) {
  const std::vector<StressTest> tests = Stress(WithPart("tilt", {0.01, 0.0}));
  EXPECT_THAT(StressReading(tests), HasSubstr("cam0: regions of the image differ: "));
}

TEST(StressTests, APrincipalPointThatJumpsIsSeenInTime) {
  SyntheticProblem problem = Problem(1);
  std::vector<View>& views = problem.input.cameras[0].views;
  for (size_t v = views.size() / 2; v < views.size(); ++v) {
    for (Observation& seen : views[v].observations) seen.values[0] += 8;
  }
  const std::vector<StressTest> tests = Stress(problem);
  EXPECT_THAT(StressReading(tests),
              HasSubstr("cam0: only the first and second half of the frames differ: "));
}

std::string FailureOf(const std::vector<StressTest>& tests, const std::string& what) {
  return std::ranges::find(tests, what, &StressTest::what)->failure;
}

TEST(StressTests, OfFewFramesAreRowsWithTheReason) {
  const std::vector<StressTest> tests = Stress(MakeProblem(1, {.frames = 7, .noise = kNoise}));
  EXPECT_EQ(tests.size(), 8u);
  EXPECT_THAT(tests, Each(Field(&StressTest::failure, "7 frames; stress tests need 8")));
  EXPECT_EQ(StressReading(tests), "");
}

TEST(StressTests, OfFramesAtOneDistanceHaveNoNearOnes) {
  SyntheticProblem problem = Problem(1);
  const Eigen::Vector3d middle(0.135, 0.09, 0);
  for (auto& [frame, T_rig_target] : problem.T_rig_target) {
    T_rig_target.t.z() += 0.5 - (T_rig_target * middle).z();
  }
  ImageBy(*problem.input.cameras[0].model, problem.params[0], &problem);
  const std::vector<StressTest> tests = Stress(problem);
  EXPECT_THAT(FailureOf(tests, "near/far"), HasSubstr("the distances of the frames differ by"));
  EXPECT_EQ(FailureOf(tests, "odd/even"), "");
}

// The border has the fifth of the points that is farthest from the middle.
TEST(StressTests, OfPointsMovedOutwardsFarFromTheMiddleDifferAtTheBorder) {
  SyntheticProblem problem = Problem(1);
  CameraInput& camera = problem.input.cameras[0];
  const Eigen::Vector2d middle((camera.image_size[0] - 1) / 2.0, (camera.image_size[1] - 1) / 2.0);
  std::vector<double> radii;
  for (const View& view : camera.views) {
    for (const Observation& seen : view.observations) {
      radii.push_back((Eigen::Vector2d(seen.values[0], seen.values[1]) - middle).norm());
    }
  }
  const double border = Quantile(radii, 0.8);
  for (View& view : camera.views) {
    for (Observation& seen : view.observations) {
      const Eigen::Vector2d r = Eigen::Vector2d(seen.values[0], seen.values[1]) - middle;
      if (r.norm() <= border) continue;
      for (int k = 0; k < 2; ++k) seen.values[static_cast<size_t>(k)] += r.normalized()[k];
    }
  }
  EXPECT_THAT(Failing(Stress(problem)), Contains("border"));
}

TEST(StressTests, OfPointsInOneQuarterOfTheImageHaveNoOtherRegion) {
  SyntheticProblem problem = Problem(1);
  const CameraInput& camera = problem.input.cameras[0];
  for (View& view : problem.input.cameras[0].views) {
    std::erase_if(view.observations, [&](const Observation& seen) {
      return seen.values[0] > camera.image_size[0] / 2.0 ||
             seen.values[1] > camera.image_size[1] / 2.0;
    });
  }
  const std::vector<StressTest> tests = Stress(problem);
  EXPECT_THAT(FailureOf(tests, "upper left"),
              HasSubstr("a calibration with 0 points of cam0; it needs 30"));
  EXPECT_THAT(FailureOf(tests, "lower right"),
              HasSubstr("the other points predict fewer than 30 there"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
