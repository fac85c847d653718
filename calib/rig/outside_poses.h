// SPDX-License-Identifier: Apache-2.0
//
// Poses from outside (robot, turntable, motion capture) against those of the calibration: where the
// rig is mounted, where the target stands, and whether the lengths agree.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "calib/camera/rigid_transform.h"
#include "calib/rig/hand_eye.h"

namespace plenocal {

/// The rig on the gripper before a target that stands in the base's frame, or the target on the
/// gripper before a rig that stands there.
enum class RigMount { kOnGripper, kOnBase };

/// One instant.
struct OutsidePose {
  RigidTransform T_base_gripper;  ///< from outside
  RigidTransform T_rig_target;    ///< from the calibration
};

enum class OutsideScale { kHeld, kFree };

struct OutsideOptions {
  RigMount mount = RigMount::kOnGripper;
  OutsideScale scale = OutsideScale::kHeld;
};

struct OutsideFit {
  /// T_gripper_rig and T_base_target; with the rig on the base T_base_rig and T_gripper_target.
  RigidTransform T_mount_rig, T_other_target;
  double scale = 1;  ///< lengths from outside over lengths of the calibration
  /// Standard errors of the charts (`Retract`) of both and of the scale (0: held).
  Vector6d rig_sigma = Vector6d::Zero(), target_sigma = Vector6d::Zero();
  double scale_sigma = 0;
  /// Scatter of one coordinate and of one angle of the poses from outside, m and rad, estimated.
  double translation_sigma = 0, rotation_sigma = 0;
  std::vector<bool> used;  ///< per instant; false: an outlier
  HandEyeGap gap = HandEyeGap::kNone;
  double largest_angle = 0;  ///< between two instants, rad
};

/// Least squares over all instants, each weighted by the scatter of positions and angles, which is
/// estimated (restricted maximum likelihood); outliers are left out (chi-square at 0.05 / N).
/// Nothing for fewer than three instants or motions that no mount explains.
std::optional<OutsideFit> FitOutsidePoses(std::span<const OutsidePose> poses,
                                          const OutsideOptions& options);

/// Spread of positions from outside over that of the calibration: about 1; 1000 for millimetres.
double RatioOfLengths(std::span<const OutsidePose> poses);

}  // namespace plenocal
