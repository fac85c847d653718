// SPDX-License-Identifier: Apache-2.0
#include "calib/estimate/start_rig.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

RigidTransform Drawn(testing::Random* random) {
  return {ExpRotation(random->Uniforms<3>(-1, 1)), random->Uniforms<3>(-1, 1)};
}

// Cameras that see the target in chosen frames, without errors but those that are added.
class RigOfCameras : public ::testing::Test {
 protected:
  // Frames by their numbers.
  void Add(const std::string& name, const std::vector<size_t>& frames) {
    T_camera_rig_.push_back(cameras_.empty() ? RigidTransform{} : Drawn(&random_));
    CameraInput camera;
    camera.name = name;
    CameraGuess guess;
    for (const size_t f : frames) {
      while (T_rig_target_.size() <= f) T_rig_target_.push_back(Drawn(&random_));
      camera.views.push_back({.frame = std::to_string(f), .observations = {}});
      guess.T_camera_target.emplace_back(T_camera_rig_.back() * T_rig_target_[f]);
    }
    cameras_.push_back(camera);
    guesses_.push_back(guess);
  }
  void ExpectTruth(const std::vector<RigidTransform>& found, double tolerance = 1e-12) const {
    ASSERT_EQ(found.size(), T_camera_rig_.size());
    for (size_t c = 0; c < found.size(); ++c) {
      EXPECT_LT((found[c].R - T_camera_rig_[c].R).norm(), tolerance) << c;
      EXPECT_LT((found[c].t - T_camera_rig_[c].t).norm(), tolerance) << c;
    }
  }

  testing::Random random_{5};
  std::vector<CameraInput> cameras_;
  std::vector<CameraGuess> guesses_;
  std::vector<RigidTransform> T_camera_rig_, T_rig_target_;
};

TEST_F(RigOfCameras, IsLinkedByChainsOfCommonFrames) {
  Add("first", {0, 1});
  Add("last", {5, 6, 7});  // shares no frame with the first
  Add("middle", {1, 5, 6});
  ExpectTruth(GuessRig(cameras_, guesses_));
}

TEST_F(RigOfCameras, IsLinkedByThePairWithMostCommonFrames) {
  Add("first", {0, 1, 2});
  Add("second", {0, 3, 4, 5});
  Add("third", {1, 2, 3, 4});
  // The only frame in common with the first is wrong; by way of the third it is right.
  guesses_[1].T_camera_target[0] = Drawn(&random_);
  ExpectTruth(GuessRig(cameras_, guesses_));
}

TEST_F(RigOfCameras, WithstandsAWrongPoseAndViewsWithoutOne) {
  Add("first", {0, 1, 2, 3, 4});
  Add("second", {0, 1, 2, 3, 4});
  guesses_[1].T_camera_target[2] = Drawn(&random_);
  guesses_[0].T_camera_target[4] = std::nullopt;
  ExpectTruth(GuessRig(cameras_, guesses_));
}

TEST_F(RigOfCameras, IsLinkedByAnEarlierCalibrationWhereNoFrameIsCommon) {
  Add("first", {0, 1});
  Add("second", {1, 2});
  Add("third", {5});
  Add("fourth", {5, 6});
  // In a frame of its own.
  const RigidTransform T_rig_earlier = Drawn(&random_);
  std::vector<std::optional<RigidTransform>> earlier(4);
  for (const size_t c : {1, 2}) earlier[c] = T_camera_rig_[c] * T_rig_earlier;
  ExpectTruth(GuessRig(cameras_, guesses_, earlier));
}

TEST_F(RigOfCameras, NamesTheCamerasWithoutALink) {
  Add("first", {0, 1});
  Add("second", {1, 2});
  Add("third", {5});
  Add("fourth", {6});
  EXPECT_THAT(testing::RefusalOf([&] { GuessRig(cameras_, guesses_); }, ErrorKind::kJob),
              ::testing::StartsWith("no frame in which third, fourth sees the target together "
                                    "with first, second: "));
}

}  // namespace TEST_FILE
}  // namespace plenocal
