// SPDX-License-Identifier: Apache-2.0
//
// Families that residuals contain: those of cameras that have them, and none of those that have
// not.
#include "assess/missing/missing_families.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "models/registry.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kNoise = 0.1;  // px

// A problem whose observations are made by a camera of another model, with this noise.
SyntheticProblem ImagedBy(unsigned seed,
                          const CameraModel& model,
                          const std::vector<double>& params,
                          double noise = kNoise) {
  SyntheticProblem problem = MakeProblem(seed, {.frames = 20, .noise = kNoise});
  Random random(seed + 1);
  for (View& view : problem.input.cameras[0].views) {
    for (Observation& seen : view.observations) {
      const Eigen::Vector3d p =
          problem.T_rig_target.at(view.frame) * problem.markers.at(seen.marker);
      EXPECT_TRUE(model.Project(params.data(), nullptr, nullptr, p, seen.values.data()));
      for (size_t k = 0; k < 2; ++k) seen.values[k] += random.Gaussian(noise);
    }
  }
  return problem;
}

// A problem whose camera has a part more than its own model, of these numbers.
SyntheticProblem WithPart(unsigned seed,
                          const std::string& part,
                          const std::vector<double>& numbers,
                          double noise = kNoise) {
  std::vector<double> params = MakeProblem(seed, {.frames = 20, .noise = kNoise}).params[0];
  params.insert(params.end(), numbers.begin(), numbers.end());
  return ImagedBy(seed, *FindModel(CameraModels(), "pinhole-radial3+" + part), params, noise);
}

std::vector<MissingFamily> MissingOf(const SyntheticProblem& problem) {
  return FindMissingFamilies(Calibrate(problem.input, {}), 0);
}

// In how many of some cameras one of the families comes first.
int FirstIn(int cameras,
            const std::vector<std::string>& families,
            const std::string& part,
            const std::vector<double>& numbers) {
  int first = 0;
  for (int seed = 0; seed < cameras; ++seed) {
    const std::vector<MissingFamily> missing =
        MissingOf(WithPart(static_cast<unsigned>(20 + seed), part, numbers));
    first += !missing.empty() && std::ranges::count(families, missing[0].family) > 0 ? 1 : 0;
  }
  return first;
}

TEST(MissingFamilies, AreNoneOfACameraThatHasItsModel) {
  int alarms = 0;
  constexpr int kCameras = 40;
  for (unsigned seed = 0; seed < kCameras; ++seed) {
    alarms += MissingOf(MakeProblem(seed, {.frames = 20, .noise = kNoise})).empty() ? 0 : 1;
  }
  EXPECT_LE(alarms, 6);  // 2 expected; more in one of 70 runs
}

// Fields at measured places contain the noise of the residuals; what three terms of distortion
// leave of them is little else.
TEST(MissingFamilies, DoNotContainTheNoise) {
  int alarms = 0;
  constexpr int kCameras = 20;
  const CameraModel& model = *FindModel(CameraModels(), "pinhole-radtan");
  for (unsigned seed = 0; seed < kCameras; ++seed) {
    SyntheticProblem problem =
        ImagedBy(seed, model, {500, 502, 322, 243, -0.15, 0.05, 1e-3, -1e-3, -0.01});
    CameraInput& camera = problem.input.cameras[0];
    camera.model = &model;
    camera.initial.resize(model.params.size());
    camera.fixed.resize(model.params.size());
    alarms += MissingOf(problem).empty() ? 0 : 1;
  }
  EXPECT_LE(alarms, 4);  // 1 expected; more in one of 400 runs
}

TEST(MissingFamilies, AreNamedFirst) {
  constexpr int kCameras = 10, kMost = 9;
  EXPECT_GE(FirstIn(kCameras, {"skew"}, "skew", {1e-3}), kMost);
  // These three differ little over the image.
  const std::vector<std::string> asymmetric{"decentring", "prism", "tilt"};
  EXPECT_GE(FirstIn(kCameras, asymmetric, "prism", {0, 0, 4e-3, 0, -3e-3, 0}), kMost);
  EXPECT_GE(FirstIn(kCameras, asymmetric, "prism", {3e-3, -3e-3, 0, 0, 0, 0}), kMost);
  EXPECT_GE(FirstIn(kCameras, asymmetric, "tilt", {0.02, -0.01}), kMost);
}

// Near frames see what far ones do not.
TEST(MissingFamilies, APupilThatMovesIsNamedFirst) {
  constexpr int kCameras = 10;
  EXPECT_GE(FirstIn(kCameras, {"pupil"}, "pupil", {0.06, 0, 0}), 9);
}

TEST(MissingFamilies, NameTheModelToTryAndWhatItGains) {
  SyntheticProblem problem = MakeProblem(3, {.frames = 20, .noise = kNoise});
  CameraInput& camera = problem.input.cameras[0];
  camera.model = FindModel(CameraModels(), "pinhole");
  camera.initial.resize(4);
  camera.fixed.resize(4);
  const std::vector<MissingFamily> missing = MissingOf(problem);
  ASSERT_FALSE(missing.empty());
  EXPECT_EQ(missing[0].family, "radial");
  EXPECT_EQ(missing[0].remedy, "try pinhole+radial4");
  EXPECT_GT(missing[0].gain, kNoise);
  EXPECT_LT(missing[0].probability, 1e-6);
  EXPECT_THAT(MissingText(missing), HasSubstr("cam0: the residuals contain radial terms ("));
  EXPECT_EQ(MissingText({}), "");
}

TEST(MissingFamilies, NameAPartOfTheCamerasModel) {
  const auto remedy = [](const std::string& part, const std::vector<double>& numbers) {
    return MissingOf(WithPart(1, part, numbers)).at(0).remedy;
  };
  EXPECT_EQ(remedy("skew", {0.01}), "try pinhole-radial3+skew");
  EXPECT_EQ(remedy("pupil", {0.1, 0, 0}), "try pinhole-radial3+pupil");
}

// Root mean square length of the residuals, without noise.
TEST(MissingFamilies, GainWhatTheModelLeaves) {
  for (const std::string part : {"skew", "pupil"}) {
    const std::vector<double> numbers =
        part == "skew" ? std::vector<double>{2e-3} : std::vector<double>{0.1, 0, 0};
    const Bundle exact = Calibrate(WithPart(4, part, numbers, 0).input, {}).bundle;
    double squares = 0;
    for (const BundleObservation& observation : exact.observations) {
      Eigen::Vector2d residual;
      ASSERT_TRUE(Residual(exact, observation, residual.data()));
      squares += residual.squaredNorm();
    }
    const double expected = std::sqrt(squares / static_cast<double>(exact.observations.size()));
    const std::vector<MissingFamily> missing = MissingOf(WithPart(4, part, numbers));
    ASSERT_EQ(missing.size(), 1U) << part;
    EXPECT_EQ(missing[0].family, part);
    EXPECT_NEAR(missing[0].gain, expected, 0.2 * expected) << part;
    EXPECT_EQ(missing[0].degrees, part == "skew" ? 1 : 2);
  }
}

TEST(MissingFamilies, ABentTargetIsNoLens) {
  int lenses = 0, boards = 0;
  constexpr int kCameras = 10;
  for (unsigned seed = 0; seed < kCameras; ++seed) {
    SyntheticProblem problem = WithPart(seed, "skew", {0});
    Random random(seed);
    const CameraModel& model = *problem.input.cameras[0].model;
    for (View& view : problem.input.cameras[0].views) {
      for (Observation& seen : view.observations) {
        Eigen::Vector3d X = problem.markers.at(seen.marker);
        X.z() += 0.02 * std::pow(X.x() - 0.135, 2);  // 0.4 mm at its edge
        ASSERT_TRUE(model.Project(problem.params[0].data(),
                                  nullptr,
                                  nullptr,
                                  problem.T_rig_target.at(view.frame) * X,
                                  seen.values.data()));
        for (size_t k = 0; k < 2; ++k) seen.values[k] += random.Gaussian(kNoise);
      }
    }
    const std::vector<MissingFamily> missing = MissingOf(problem);
    if (missing.empty()) continue;
    (missing[0].family == "board" ? boards : lenses) += 1;
    if (missing[0].family == "board") {
      EXPECT_EQ(missing[0].remedy, "set refine_target, or use a flat target");
    }
  }
  EXPECT_EQ(lenses, 0);
  EXPECT_GE(boards, 8);
}

TEST(MissingFamilies, NeedSeveralViews) {
  EXPECT_THAT(MissingOf(MakeProblem(1, {.frames = 3, .noise = kNoise})), IsEmpty());
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
