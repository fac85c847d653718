// SPDX-License-Identifier: Apache-2.0
//
// Pose of a rig on a robot (hand-eye calibration), from a calibration and the robot's poses.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/rig/outside_poses.h"

namespace plenocal {

struct HandEyeRequest {
  std::filesystem::path folder;  ///< of a calibration
  std::filesystem::path poses;   ///< from outside, T_base_gripper in m: by frame, or by time
  std::filesystem::path times;   ///< of the frames, for poses by time; empty: their names
  RigMount mount = RigMount::kOnGripper;
  OutsideScale scale = OutsideScale::kFixed;
  std::filesystem::path out;  ///< handeye.yaml; empty: none is written
};

struct MountedRig {
  RigMount mount = RigMount::kOnGripper;
  OutsideScale scale = OutsideScale::kFixed;
  OutsideFit fit;
  std::vector<std::string> frames;   ///< names of those of `fit`
  std::optional<double> time_shift;  ///< of poses by time, s: added to the times of the images
  size_t without = 0;                ///< frames of the calibration without a pose
  /// Why standard errors leave out those of the calibration; empty: they do not.
  std::string without_errors;
};

/// Throws `Error`: of kind kJob for poses that no mount explains.
MountedRig FindHandEye(const HandEyeRequest& request, const Run& run);

/// For the terminal.
std::string HandEyeText(const MountedRig& result);
/// Content of handeye.yaml.
std::string HandEyeYaml(const MountedRig& result);

}  // namespace plenocal
