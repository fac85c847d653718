// SPDX-License-Identifier: Apache-2.0
//
// Hand-eye poses from files of simulated motions, and what is said and written about them.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "calib/files/calibration_tables.h"
#include "engine/rigs/hand_eye_poses.h"
#include "engine/rigs/pose_text.h"
#include "tests/calib/random.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kScatter = 2e-5;  // m and rad
constexpr int kFrames = 5;

const RigidTransform kGripperRig{ExpRotation({0.3, -0.2, 0.1}), {0.05, -0.02, 0.1}};
const RigidTransform kBaseTarget{ExpRotation({-0.5, 0.4, 1.2}), {0.8, 0.3, -0.1}};

double ErrorOf(const RigidTransform& found, const RigidTransform& truth) {
  return (found.t - truth.t).norm() + LogRotation(found.R * truth.R.transpose()).norm();
}

// A smooth motion of a gripper.
RigidTransform GripperAt(double time) {
  return {
      ExpRotation({0.6 * std::sin(time), 0.5 * std::cos(1.3 * time), 0.4 * std::sin(0.7 * time)}),
      {0.3 * std::cos(0.9 * time), 0.2 * std::sin(1.1 * time), 0.2 * std::sin(0.6 * time)}};
}

RigidTransform Noisy(const RigidTransform& T, Random* random) {
  Vector6d error;
  error << random->Gaussians<3>(kScatter), random->Gaussians<3>(kScatter);
  return Retract(T, error);
}

class HandEye : public ::testing::Test {
 protected:
  // poses.csv of a calibration at these times, with these names of frames.
  void WriteCalibration(const std::vector<double>& times,
                        const std::function<std::string(double)>& name) {
    CalibrationRecord record;
    for (const double time : times) {
      const RigidTransform T_rig_target = (GripperAt(time) * kGripperRig).Inverse() * kBaseTarget;
      record.frames.push_back({name(time), T_rig_target.Inverse()});
    }
    folder_.Write("result/poses.csv", PosesCsv(record));
  }

  // T_base_gripper by frame; `change` of each.
  void WriteGripper(const std::vector<std::pair<std::string, double>>& frames,
                    const std::function<RigidTransform(RigidTransform)>& change = {}) {
    CalibrationRecord record;
    Random random(1);
    for (const auto& [name, time] : frames) {
      const RigidTransform T = Noisy(GripperAt(time), &random);
      record.frames.push_back({name, change ? change(T) : T});
    }
    folder_.Write("robot.csv", PosesCsv(record));
  }

  // Frames a0, a1, ...; the calibration has two more, the robot one more.
  void WriteNamed(const std::function<RigidTransform(RigidTransform)>& change = {}) {
    std::vector<double> times{100, 101};
    std::vector<std::pair<std::string, double>> frames{{"other", 50}};
    for (int k = 0; k < kFrames; ++k) {
      times.push_back(0.7 * k);
      frames.emplace_back(Name(0.7 * k), 0.7 * k);
    }
    WriteCalibration(times, Name);
    WriteGripper(frames, change);
  }

  static std::string Name(double time) { return fmt::format("a{:.0f}", time / 0.7); }

  [[nodiscard]] HandEyeRequest Request() const {
    HandEyeRequest request;
    request.folder = folder_ / "result";
    request.poses = folder_ / "robot.csv";
    return request;
  }

  // Without the paths of the folder.
  [[nodiscard]] std::string Refused(const HandEyeRequest& request,
                                    const plenocal::Run& run = {}) const {
    std::string why = Refusal([&] { FindHandEye(request, run); });
    const std::string path = (folder_ / "").string();
    for (size_t at = why.find(path); at != std::string::npos; at = why.find(path)) {
      why.erase(at, path.size());
    }
    return why;
  }

  // That ends before the fit.
  static plenocal::Run StoppedRun() {
    std::stop_source stop;
    stop.request_stop();
    plenocal::Run run;
    run.stop = stop.get_token();
    return run;
  }

  TemporaryFolder folder_;
};

TEST_F(HandEye, PosesByNameGiveTheMount) {
  WriteNamed();
  HandEyeRequest request = Request();
  request.out = folder_ / "handeye.yaml";
  const MountedRig found = FindHandEye(request, {});
  EXPECT_LT(ErrorOf(found.fit.T_mount_rig, kGripperRig), 3e-4);
  EXPECT_LT(ErrorOf(found.fit.T_other_target, kBaseTarget), 3e-4);
  EXPECT_EQ(found.fit.scale, 1);
  EXPECT_EQ(found.without, 2U);
  EXPECT_EQ(found.frames.size(), static_cast<size_t>(kFrames));
  EXPECT_EQ(found.frames[3], "a3");
  EXPECT_FALSE(found.time_shift);
  EXPECT_THAT(found.without_errors, HasSubstr("calibration.yaml"));
  EXPECT_EQ(folder_.Read("handeye.yaml"), HandEyeYaml(found));
}

TEST_F(HandEye, AFreeScaleIsThatOfTheLengthsFromOutside) {
  WriteNamed([](RigidTransform T) {
    T.t *= 1.02;
    return T;
  });
  HandEyeRequest request = Request();
  request.scale = OutsideScale::kFree;
  EXPECT_NEAR(FindHandEye(request, {}).fit.scale, 1.02, 1e-3);
}

TEST_F(HandEye, PosesOfTheOtherWayRoundAreNamed) {
  WriteNamed();
  HandEyeRequest request = Request();
  request.mount = RigMount::kOnBase;
  EXPECT_THAT(Refused(request),
              ::testing::MatchesRegex(
                  "job: robot.csv: the poses fit the other way round only \\(to 0.0[0-9]+ mm, "
                  "0.00[0-9]+ degrees\\). Either they map the base to the gripper, and must be "
                  "inverted, or the rig is mounted on the gripper: --mount gripper"));
  WriteNamed([](const RigidTransform& T) { return T.Inverse(); });
  EXPECT_THAT(Refused(Request()),
              EndsWith("must be inverted, or the rig is mounted on the base: --mount base"));
}

TEST_F(HandEye, PositionsInAnotherUnitAreRefused) {
  const auto scaled = [&](double factor) {
    WriteNamed([=](RigidTransform T) {
      T.t *= factor;
      return T;
    });
    return Refused(Request(), StoppedRun());
  };
  EXPECT_THAT(
      scaled(1000),
      ::testing::MatchesRegex(
          "input: robot.csv: its positions move [0-9.]+(e\\+03)? times as far as those of the "
          "calibration; are they in millimetres\\? Give them in metres"));
  EXPECT_THAT(scaled(0.01), HasSubstr("are they in another unit? Give them in metres"));
  // Stopped once the units are accepted.
  EXPECT_THROW(scaled(25), Stopped);
  EXPECT_THROW(scaled(1.0 / 25), Stopped);
}

TEST_F(HandEye, FewerThanThreePosesWithAFrameAreRefused) {
  WriteCalibration({0, 0.7, 1.4, 2.1}, Name);
  WriteGripper({{"b0", 0}, {"a1", 0.7}, {"a2", 1.4}});
  EXPECT_EQ(Refused(Request()),
            "input: robot.csv: 2 of its 3 poses have a frame of result/poses.csv ('b0', ...; there "
            "'a0', ...); the column 'frame' must have the names of the images");
  WriteGripper({{"a0", 0}, {"a1", 0.7}, {"a2", 1.4}});
  EXPECT_THROW(FindHandEye(Request(), StoppedRun()), Stopped);
  HandEyeRequest request = Request();
  request.times = folder_ / "times.txt";
  EXPECT_EQ(Refused(request),
            "input: --times: the poses from outside name frames and need no times");
}

TEST_F(HandEye, AStopEndsTheWork) {
  WriteNamed();
  plenocal::Run run = StoppedRun();
  std::vector<std::string> stages;
  run.listener.progress = [&](const std::string& stage, size_t, size_t) {
    stages.push_back(stage);
  };
  EXPECT_THROW(FindHandEye(Request(), run), Stopped);
  EXPECT_THAT(stages, ElementsAre("hand-eye pose"));
}

// Logged from 1000 to 1002 s.
class HandEyeByTime : public HandEye {
 protected:
  void SetUp() override {
    std::string rows = "# t x y z qx qy qz qw\n";
    for (int k = 0; k <= 20; ++k) rows += fmt::format("{:.1f} {} 0 0 0 0 0 1\n", 1000 + 0.1 * k, k);
    folder_.Write("robot.csv", rows);
  }
};

TEST_F(HandEyeByTime, NamesThatAreNoTimesAndLogsOfOtherTimesAreRefused) {
  WriteCalibration({0.5, 0.6, 0.7}, [](double time) { return fmt::format("a{:.3f}", time); });
  EXPECT_EQ(Refused(Request()),
            "input: result/poses.csv: frame 'a0.500' is no time, and the poses from outside have "
            "times; give those of the frames by --times");
  WriteCalibration({0.5, 0.6, 0.7}, [](double time) { return fmt::format("{:.3f}", time); });
  EXPECT_EQ(Refused(Request()),
            "input: robot.csv: 0 of the 3 frames of result/poses.csv lie in its times, 1000.000 to "
            "1002.000 s; the first frame is at 0.500 s");
  // Above 1e11 they are nanoseconds.
  WriteCalibration({500, 600, 700},
                   [](double time) { return fmt::format("{:.0f}", 1e9 * time + 5e8); });
  EXPECT_THAT(Refused(Request()), EndsWith("the first frame is at 500.500 s"));
}

MountedRig Found() {
  MountedRig result;
  result.fit.T_mount_rig.t = {0.1, -0.2, 0.3};
  result.fit.T_mount_rig.R = ExpRotation({0, 0, std::numbers::pi / 2});
  result.fit.T_other_target.t = {1, 2, 3};
  result.fit.rig_sigma << 1e-3, 2e-3, 3e-3, 1e-4, 2e-4, 3e-4;
  result.fit.target_sigma << 0.01, 0.02, kInfinite, 0.1, 0.2, 0.3;
  result.fit.scale = 1.25;
  result.fit.scale_sigma = 0.5;
  result.fit.translation_sigma = 2e-3;
  result.fit.rotation_sigma = std::numbers::pi / 180;
  result.fit.used = {true, false, true, true};
  result.frames = {"a", "b", "c", "d"};
  return result;
}

const std::string kPoses =
    "rig in the gripper's frame: (100.000, -200.000, 300.000) +- (1.000, 2.000, 3.000) mm, rotation "
    "vector (0.0000, 0.0000, 90.0000) +- (0.0057, 0.0115, 0.0172) degrees\n"
    "target in the base's frame: (1000.000, 2000.000, 3000.000) +- (10.000, 20.000, inf) mm, "
    "rotation vector (0.0000, 0.0000, 0.0000) +- (5.7296, 11.4592, 17.1887) degrees\n";
const std::string kScatterText =
    "poses from outside scatter by 2.000 mm and 1.0000 degrees about it, over 4 frames\n"
    "  left out: frame b, which is far off\n";

TEST(HandEyeText, NamesPosesScatterAndOutliers) {
  MountedRig result = Found();
  EXPECT_EQ(HandEyeText(result), kPoses + kScatterText);
  result.mount = RigMount::kOnBase;
  EXPECT_THAT(HandEyeText(result), ::testing::StartsWith("rig in the base's frame: (100.000"));
  EXPECT_THAT(HandEyeText(result), HasSubstr("\ntarget in the gripper's frame: (1000.000"));
  result = Found();
  result.scale = OutsideScale::kFree;
  result.without = 3;
  EXPECT_EQ(HandEyeText(result),
            kPoses +
                "lengths from outside are 1.25000 +- 0.50000 times those of the calibration\n" +
                kScatterText + "  frames without a pose: 3\n");
}

TEST(HandEyeText, NamesTheClocks) {
  MountedRig result = Found();
  result.time_shift = -0.0125;
  result.fit.time_shift_sigma = 4e-4;
  EXPECT_THAT(HandEyeText(result),
              EndsWith("clocks: -12.500 +- 0.4 ms are added to the times of the images\n"));
  result.fit.time_shift_sigma = kInfinite;
  EXPECT_THAT(HandEyeText(result),
              EndsWith("clocks: their difference is open; the rig was at rest in the frames\n"));
}

TEST(HandEyeText, NamesErrorsThatAreLeftOutOrContradicted) {
  MountedRig result = Found();
  // Two numbers: the 0.999 quantile of chi-square is 13.816.
  result.fit.calibration_errors = Eigen::Vector2d(3.71, 0);
  EXPECT_EQ(HandEyeText(result), kPoses + kScatterText);
  result.fit.calibration_errors = Eigen::Vector2d(0, -3.72);
  EXPECT_EQ(
      HandEyeText(result),
      kPoses + kScatterText +
          "the poses contradict the calibration: its parameters would have to be wrong by more "
          "than their standard errors. See its report, and check the robot's own "
          "calibration\n");
  result.without_errors = "no file";
  EXPECT_EQ(
      HandEyeText(result),
      kPoses + kScatterText + "standard errors leave out those of the calibration: no file\n");
}

TEST(HandEyeText, NamesOpenDirections) {
  MountedRig result = Found();
  result.fit.open = Eigen::MatrixXd::Zero(12, 1);
  result.fit.open(1, 0) = -3;
  result.fit.open(2, 0) = 4;
  EXPECT_EQ(
      HandEyeText(result),
      kPoses + kScatterText +
          "NOT DETERMINED: all rotations are about one axis, up to the noise of the poses; the "
          "translation along it is open, (0.000, -0.600, 0.800) in the gripper's frame for "
          "the rig. Turn the gripper about a second axis by 15 degrees or more.\n");
  result.mount = RigMount::kOnBase;
  EXPECT_THAT(HandEyeText(result), HasSubstr("0.800) in the base's frame for the rig. "));
  result.fit.open = Eigen::MatrixXd::Ones(12, 2);
  EXPECT_THAT(HandEyeText(result),
              EndsWith("NOT DETERMINED: the gripper hardly turned; turn it about two axes by 15 "
                       "degrees or more.\n"));
}

TEST(HandEyeYaml, HasPosesAsMatricesWithTheirStandardErrors) {
  MountedRig result = Found();
  result.fit.T_mount_rig.R << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  const std::string
      head =
          "plenocal: 1\nmount: gripper\n"
          "T_gripper_rig: [[0, -1, 0, 0.1], [1, 0, 0, -0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]]\n"
          "sigma_gripper_rig: [0.001, 0.002, 0.003, 0.0001, 0.0002, 0.0003]\n"
          "T_base_target: [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]\n"
          "sigma_base_target: [0.01, 0.02, .inf, 0.1, 0.2, 0.3]\n",
      scale =
          "scale: 1.25\nsigma_scale: 0.5\n"
          "scatter: {translation: 0.002, rotation: 0.0174533}\n",
      tail = "calibration_errors: included\nframes: 4\nleft_out: 1\n";
  std::string yaml = HandEyeYaml(result);
  EXPECT_THAT(yaml, ::testing::StartsWith(head));
  EXPECT_THAT(yaml, EndsWith(scale + tail));
  result.time_shift = 0.25;
  result.fit.time_shift_sigma = kInfinite;
  EXPECT_THAT(HandEyeYaml(result),
              EndsWith(scale + "time_shift: 0.25\nsigma_time_shift: .inf\n" + tail));
  result.without_errors = "none";
  EXPECT_THAT(HandEyeYaml(result), HasSubstr("calibration_errors: left_out\n"));
  result.fit.open = Eigen::MatrixXd::Zero(12, 1);
  result.fit.open(2, 0) = 1;
  result.fit.open(8, 0) = -1;
  yaml = HandEyeYaml(result);
  EXPECT_THAT(yaml, HasSubstr("T_gripper_rig.z"));
  EXPECT_THAT(yaml, HasSubstr("T_base_target.z"));
  result.mount = RigMount::kOnBase;
  yaml = HandEyeYaml(result);
  EXPECT_THAT(yaml,
              ::testing::StartsWith("plenocal: 1\nmount: base\nT_base_rig: [[0, -1, 0, 0.1]"));
  EXPECT_THAT(yaml, HasSubstr("\nT_gripper_target: [[1, 0, 0, 1]"));
  EXPECT_THAT(yaml, HasSubstr("T_gripper_target.z"));
}

TEST(PoseText, HasMillimetresAndDegrees) {
  Vector6d pose, sigma;
  pose << 1, -0.0005, 0.25, std::numbers::pi, -std::numbers::pi / 6, 0;
  sigma << 1e-3, 2e-6, 0, 0.1, 1, std::numbers::pi / 1800;
  EXPECT_EQ(PoseText(pose, sigma),
            "(1000.000, -0.500, 250.000) +- (1.000, 0.002, 0.000) mm, (180.0000, -30.0000, 0.0000) "
            "+- (5.7296, 57.2958, 0.1000) degrees");
  EXPECT_THAT(PoseText(pose, sigma, "w = "), HasSubstr(" mm, w = (180.0000"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
