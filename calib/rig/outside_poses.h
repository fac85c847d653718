// SPDX-License-Identifier: Apache-2.0
//
// Poses from outside (robot, turntable, motion capture) against those of the calibration: the pose
// of the rig on its mount, that of the target, and the ratio of lengths. With the covariance of
// the calibration's poses this is the joint adjustment of images and poses from outside, linear in
// the calibration's errors.
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

/// Errors of one pose of a calibration in the chart of T_rig_target (`Retract`), m and rad.
struct PoseErrors {
  Matrix6d own = Matrix6d::Zero();  ///< covariance of what no other pose shares
  /// Per column the displacement by one of the calibration's errors, which all poses share and
  /// which are independent and standard normal: those of parameters, extrinsics and target.
  Eigen::Matrix<double, 6, Eigen::Dynamic> shared = {};
};

/// One instant.
struct OutsidePose {
  RigidTransform T_base_gripper;  ///< from outside
  RigidTransform T_rig_target;    ///< from the calibration
  PoseErrors errors = {};         ///< of T_rig_target; as many shared ones for each pose
  /// Velocity of T_base_gripper in its chart, m/s and rad/s, where it was found by time.
  Vector6d velocity = Vector6d::Zero();
  /// Covariance of the errors of T_base_gripper and its velocity, a coordinate each, m^2/s and
  /// rad^2/s.
  Vector6d velocity_covariance = Vector6d::Zero();
};

enum class OutsideScale { kFixed, kFree };

/// A shift of the clock of the poses from outside, to be estimated: errors of their velocities.
struct FreeTimeShift {
  double velocity_sigma = 0, angular_velocity_sigma = 0;  ///< of a coordinate, m/s and rad/s
};

struct OutsideOptions {
  RigMount mount = RigMount::kOnGripper;
  OutsideScale scale = OutsideScale::kFixed;
  /// So many instants share the errors of their poses from outside: standard errors are larger by
  /// its root than those of independent instants.
  double instants_per_error = 1;
  std::optional<FreeTimeShift> time_shift = {};  ///< nothing: the instants are those of the poses
  bool standard_errors = true;                   ///< false: they stay zero, and nothing is open
};

struct OutsideFit {
  /// T_gripper_rig and T_base_target; with the rig on the base T_base_rig and T_gripper_target.
  RigidTransform T_mount_rig, T_other_target;
  double scale = 1;  ///< lengths from outside over lengths of the calibration
  /// Standard errors of the charts (`Retract`) of both (infinite where the motion leaves them open)
  /// and of the scale (0: fixed).
  Vector6d rig_sigma = Vector6d::Zero(), target_sigma = Vector6d::Zero();
  double scale_sigma = 0;
  /// The poses from outside fit best so much later, s, and its standard error (infinite where the
  /// motion leaves it open; 0: fixed).
  double time_shift = 0, time_shift_sigma = 0;
  /// Scatter of one coordinate and of one angle of the poses from outside, m and rad, estimated.
  double translation_sigma = 0, rotation_sigma = 0;
  std::vector<bool> used;  ///< per instant; false: an outlier
  /// Columns: directions of both charts (m and rad, T_mount_rig first) that the motion leaves open.
  Eigen::Matrix<double, 12, Eigen::Dynamic> open = {};
  /// Estimates of the calibration's errors, in standard deviations: from outside poses may show
  /// more of them than the images did.
  Eigen::VectorXd calibration_errors = {};
};

/// Generalised least squares over all instants with the calibration's errors and the scatter of
/// positions and angles from outside, which is estimated (restricted maximum likelihood: Harville
/// 1977, by fixed-point iteration); outliers are left out (chi-square at 0.05 / N).
/// Nothing for fewer than three instants or motions that no mount explains.
std::optional<OutsideFit> FitOutsidePoses(std::span<const OutsidePose> poses,
                                          const OutsideOptions& options);

/// Spread of positions from outside over that of the calibration: about 1; 1000 for millimetres.
double RatioOfLengths(std::span<const OutsidePose> poses);

}  // namespace plenocal
