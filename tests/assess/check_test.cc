// SPDX-License-Identifier: Apache-2.0
#include "assess/check.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "calib/estimate/describe.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kNoise = 0.2;  // px

class CheckOfAPair : public ::testing::Test {
 protected:
  CheckOfAPair() : exact_(MakeProblem(3, {.cameras = 2, .frames = 12}).input) {
    old_ = Describe(Calibrate(WithNoise(exact_, kNoise, 1), {}));
    old_.path = "old.yaml";
  }

  [[nodiscard]] CalibrationCheck Checked() const {
    return CheckCalibration(old_, WithNoise(exact_, kNoise, 2), {});
  }

  CalibrationInput exact_;
  CalibrationRecord old_;
};

// Codes of the bad findings with their cameras.
std::vector<std::string> BadFindings(const CalibrationCheck& check) {
  std::vector<std::string> bad;
  for (const Finding& finding : JudgeCheck(check).findings) {
    EXPECT_EQ(finding.limit, check.level);
    const auto camera = std::ranges::find(check.cameras, finding.cameras.at(0), &CameraCheck::name);
    EXPECT_EQ(
        finding.value,
        finding.code == "mount_changed" ? camera->extrinsics_probability : camera->probability);
    EXPECT_EQ(finding.remedy.empty(), finding.grade != Grade::kBad);
    if (finding.grade == Grade::kBad) bad.push_back(finding.code + " " + finding.cameras[0]);
  }
  return bad;
}

TEST_F(CheckOfAPair, OfTheSameCamerasIsValid) {
  const CalibrationCheck check = Checked();
  EXPECT_TRUE(check.valid);
  EXPECT_EQ(check.frames, 12);
  EXPECT_DOUBLE_EQ(check.level, 0.01 / 3);  // three tests
  EXPECT_THAT(BadFindings(check), ElementsAre());
  EXPECT_EQ(JudgeCheck(check).findings.size(), 3);
  ASSERT_EQ(check.cameras.size(), 2);
  for (size_t c = 0; c < 2; ++c) {
    const CameraCheck& camera = check.cameras[c];
    int points = 0;
    for (const View& view : exact_.cameras[c].views) {
      points += static_cast<int>(view.observations.size());
    }
    EXPECT_EQ(camera.name, exact_.cameras[c].name);
    EXPECT_NEAR(camera.points, points, 0.01 * points);
    EXPECT_NEAR(camera.rms_free, std::sqrt(2) * kNoise, 0.05 * kNoise);
    EXPECT_GT(camera.rms_held, camera.rms_free);
    EXPECT_NEAR(camera.rms_held, camera.expected, 0.01 * camera.expected);
    EXPECT_TRUE(camera.valid);
  }
  // The master is at its place.
  EXPECT_EQ(check.cameras[0].extrinsics_probability, 1);
  EXPECT_EQ(check.cameras[0].rotation, 0);
  EXPECT_LT(check.cameras[1].translation, 1e-3);
  EXPECT_GT(check.cameras[1].translation, 0);
}

// Probabilities of right hypotheses are uniform: their mean of 10 seeds and three tests scatters by
// 0.053.
TEST_F(CheckOfAPair, HasUniformProbabilities) {
  double sum = 0;
  int count = 0;
  for (unsigned seed = 10; seed < 20; ++seed) {
    const CalibrationCheck check =
        CheckCalibration(Describe(Calibrate(WithNoise(exact_, kNoise, 100 + seed), {})),
                         WithNoise(exact_, kNoise, seed),
                         {});
    for (const CameraCheck& camera : check.cameras) {
      sum += camera.probability;
      ++count;
    }
    sum += check.cameras[1].extrinsics_probability;
    ++count;
  }
  EXPECT_NEAR(sum / count, 0.5, 3 * std::sqrt(1.0 / 12 / count));
}

TEST_F(CheckOfAPair, NamesTheCameraThatHasChanged) {
  old_.cameras[1].params[0] *= 1.01;
  const CalibrationCheck check = Checked();
  EXPECT_FALSE(check.valid);
  EXPECT_TRUE(check.cameras[0].valid);
  EXPECT_FALSE(check.cameras[1].valid);
  EXPECT_GT(check.cameras[0].probability, check.level);
  EXPECT_LT(check.cameras[1].probability, check.level);
  EXPECT_GT(check.cameras[1].rms_held, 1.5 * check.cameras[1].rms_free);
  EXPECT_GT(check.cameras[1].rms_held, 1.5 * check.cameras[1].expected);
  EXPECT_THAT(BadFindings(check),
              ::testing::Contains("parameters_changed " + check.cameras[1].name));
  const Finding first = JudgeCheck(check).findings[0];
  EXPECT_THAT(first.what,
              HasSubstr(fmt::format("the old parameters leave {:.3g} px RMS in the new images, "
                                    "those of the new images' own {:.3g} px",
                                    check.cameras[1].rms_held,
                                    check.cameras[1].rms_free)));
}

TEST_F(CheckOfAPair, NamesTheMountThatHasChanged) {
  const RigidTransform change{ExpRotation({0.01, 0, 0}), {0, 0.005, 0}};
  old_.cameras[1].T_camera_rig = old_.cameras[1].T_camera_rig * change;
  const CalibrationCheck check = Checked();
  EXPECT_FALSE(check.valid);
  EXPECT_THAT(BadFindings(check), ElementsAre("mount_changed " + check.cameras[1].name));
  EXPECT_GT(check.cameras[1].probability, check.level);
  EXPECT_NEAR(check.cameras[1].rotation, 0.01, 0.001);
  EXPECT_LT(check.cameras[1].extrinsics_probability, 1e-6);
  EXPECT_THAT(JudgeCheck(check).findings[0].what, HasSubstr("turned by 0.5"));
}

// A camera of which f_x alone was estimated: all others stay what they are.
TEST_F(CheckOfAPair, HoldsWhatWasHeld) {
  exact_.cameras.pop_back();
  CameraInput& camera = exact_.cameras[0];
  camera.fixed.assign(camera.model->params.size(), true);
  camera.fixed[0] = false;
  const std::vector<double> truth = MakeProblem(3, {.cameras = 2, .frames = 12}).params[0];
  camera.initial.assign(truth.begin(), truth.end());
  old_ = Describe(Calibrate(WithNoise(exact_, kNoise, 1), {}));
  ASSERT_LT(old_.cameras[0].covariance(0, 0), 0.5);
  // The session of the check holds nothing.
  camera.fixed.assign(camera.model->params.size(), false);
  const CalibrationCheck right = Checked();
  const std::vector<bool>& fixed = right.fresh.bundle.cameras[0].fixed;
  EXPECT_FALSE(fixed[0]);
  EXPECT_EQ(std::count(fixed.begin(), fixed.end(), true), std::ssize(fixed) - 1);
  EXPECT_TRUE(right.valid);
  EXPECT_LT(right.cameras[0].probability, 1);
  old_.cameras[0].params[0] += 8 * old_.cameras[0].Sigma(0);
  const CalibrationCheck changed = Checked();
  EXPECT_FALSE(changed.valid);
  EXPECT_LT(changed.cameras[0].probability, 1e-3);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
