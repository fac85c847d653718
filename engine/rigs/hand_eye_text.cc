// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/base/statistics.h"
#include "calib/files/calibration_file.h"
#include "calib/noise/open_directions.h"
#include "engine/rigs/hand_eye_poses.h"
#include "engine/rigs/pose_text.h"

namespace plenocal {
namespace {

std::string MountName(const MountedRig& result) {
  return result.mount == RigMount::kOnGripper ? "gripper" : "base";
}

std::string PoseYaml(const std::string& name, const RigidTransform& T, const Vector6d& sigma) {
  std::string text = fmt::format("T_{}: [", name);
  for (int r = 0; r < 3; ++r) {
    text += fmt::format(
        "[{:.12g}, {:.12g}, {:.12g}, {:.12g}], ", T.R(r, 0), T.R(r, 1), T.R(r, 2), T.t[r]);
  }
  std::vector<std::string> sigmas;
  for (const double value : sigma) sigmas.push_back(YamlNumber(value));
  return text + fmt::format("[0, 0, 0, 1]]\nsigma_{}: [{}]\n", name, fmt::join(sigmas, ", "));
}

// Names of both poses in the file, that of the rig first.
std::array<std::string, 2> PoseNames(const MountedRig& result) {
  if (result.mount == RigMount::kOnGripper) return {"gripper_rig", "base_target"};
  return {"base_rig", "gripper_target"};
}

std::vector<OpenDirection> OpenDirections(const MountedRig& result) {
  std::vector<std::string> names;
  for (const std::string& pose : PoseNames(result)) {
    for (const char* coordinate : kExtrinsicsNames) {
      names.push_back(fmt::format("T_{}.{}", pose, coordinate));
    }
  }
  std::vector<OpenDirection> directions;
  for (const auto& direction : result.fit.open.colwise()) {
    directions.push_back(Describe(direction, std::numeric_limits<double>::infinity(), names));
  }
  return directions;
}

std::string MountText(const char* what, const RigidTransform& T, const Vector6d& sigma) {
  Vector6d pose;
  pose << T.t, LogRotation(T.R);
  return fmt::format("{}: {}\n", what, PoseText(pose, sigma, "rotation vector "));
}

// By chi-square: estimates of independent standard normal errors.
bool ContradictsCalibration(const OutsideFit& fit) {
  constexpr double kFalse = 1e-3;
  const auto count = static_cast<double>(fit.calibration_errors.size());
  return count > 0 && fit.calibration_errors.squaredNorm() > ChiSquareQuantile(count, kFalse);
}

}  // namespace

std::string HandEyeYaml(const MountedRig& result) {
  const OutsideFit& fit = result.fit;
  const auto [rig, target] = PoseNames(result);
  std::string text = "plenocal: 1\nmount: " + MountName(result) + "\n";
  text += PoseYaml(rig, fit.T_mount_rig, fit.rig_sigma);
  text += PoseYaml(target, fit.T_other_target, fit.target_sigma);
  text += UndeterminedYaml(OpenDirections(result));
  text += fmt::format("scale: {:.12g}\nsigma_scale: {:.6g}\n", fit.scale, fit.scale_sigma);
  text += fmt::format("scatter: {{translation: {:.6g}, rotation: {:.6g}}}\n",
                      fit.translation_sigma,
                      fit.rotation_sigma);
  if (result.time_shift) {
    text += fmt::format("time_shift: {:.9g}\nsigma_time_shift: {}\n",
                        *result.time_shift,
                        YamlNumber(fit.time_shift_sigma));
  }
  text += fmt::format("calibration_errors: {}\n",
                      result.without_errors.empty() ? "included" : "left_out");
  return text + fmt::format("frames: {}\nleft_out: {}\n",
                            fit.used.size(),
                            std::ranges::count(fit.used, false));
}

std::string HandEyeText(const MountedRig& result) {
  const OutsideFit& fit = result.fit;
  constexpr double kDegrees = 180 / std::numbers::pi;
  const bool on_gripper = result.mount == RigMount::kOnGripper;
  std::string text =
      MountText(on_gripper ? "rig in the gripper's frame" : "rig in the base's frame",
                fit.T_mount_rig,
                fit.rig_sigma);
  text += MountText(on_gripper ? "target in the base's frame" : "target in the gripper's frame",
                    fit.T_other_target,
                    fit.target_sigma);
  if (result.scale == OutsideScale::kFree) {
    text +=
        fmt::format("lengths from outside are {:.5f} +- {:.5f} times those of the calibration\n",
                    fit.scale,
                    fit.scale_sigma);
  }
  text += fmt::format(
      "poses from outside scatter by {:.3f} mm and {:.4f} degrees about it, over {} "
      "frames\n",
      1e3 * fit.translation_sigma,
      kDegrees * fit.rotation_sigma,
      fit.used.size());
  for (size_t i = 0; i < fit.used.size(); ++i) {
    if (!fit.used[i])
      text += fmt::format("  left out: frame {}, which is far off\n", result.frames[i]);
  }
  if (result.time_shift && std::isinf(fit.time_shift_sigma)) {
    text += "clocks: their difference is open; the rig was at rest in the frames\n";
  } else if (result.time_shift) {
    text += fmt::format("clocks: {:.3f} +- {:.2g} ms are added to the times of the images\n",
                        1e3 * *result.time_shift,
                        1e3 * fit.time_shift_sigma);
  }
  if (!result.without_errors.empty()) {
    text += "standard errors leave out those of the calibration: " + result.without_errors + "\n";
  } else if (ContradictsCalibration(fit)) {
    text +=
        "the poses contradict the calibration: its parameters would have to be wrong by more than "
        "their standard errors. See its report, and check the robot's own calibration\n";
  }
  if (result.without > 0) text += fmt::format("  frames without a pose: {}\n", result.without);
  if (fit.open.cols() == 1) {
    const Eigen::Vector3d axis = fit.open.col(0).head<3>().normalized();
    text += fmt::format(
        "NOT DETERMINED: all rotations are about one axis, up to the noise of the poses; the "
        "translation along it is open, ({:.3f}, {:.3f}, {:.3f}) in the {}'s frame for the rig. "
        "Turn the gripper about a second axis by 15 degrees or more.\n",
        axis.x(),
        axis.y(),
        axis.z(),
        MountName(result));
  } else if (fit.open.cols() > 1) {
    text +=
        "NOT DETERMINED: the gripper hardly turned; turn it about two axes by 15 degrees or more.\n";
  }
  return text;
}

}  // namespace plenocal
