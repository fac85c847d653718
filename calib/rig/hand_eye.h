// SPDX-License-Identifier: Apache-2.0
//
// Two unknown rigid transforms around a chain of known ones: A_i = X B_i Y. With two cameras on a
// rig before two boards that stay where they are, X is one camera in the other's frame and Y one
// board in the other's; with a robot's poses, the hand-eye and the robot-world transform.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "calib/camera/rigid_transform.h"

namespace plenocal {

/// One instant: A and B of A = X B Y.
struct HandEyePair {
  RigidTransform A, B;
};

/// The part of X (and of Y with it) that the motion leaves open.
enum class HandEyeGap {
  kNone,
  kAlongAxis,    ///< all rotations are about one axis: the translation along it
  kTranslation,  ///< hardly any rotation: the translation, and where that hardly varies, rotation
};

struct HandEye {
  RigidTransform X, Y;
  double rotation_rms = 0, translation_rms = 0;  ///< of A_i^-1 X B_i Y, rad and m
  HandEyeGap gap = HandEyeGap::kNone;
  Eigen::Vector3d axis{0, 0, 0};  ///< of `kAlongAxis`, unit vector in the frame of A
  /// Typical error of X for errors of the poses as large as those that are left: how far points at
  /// the typical distance move, m. Large for few instants and rotations about nearly one axis.
  double error = 0;
};

/// X and Y of least squares, robust against a minority of wrong poses: rotation from the axes of
/// all motions, then translation (Park and Martin 1994), then all twelve together. Where the motion
/// leaves a direction open, X has the least translation along it. Nothing for fewer than three
/// instants or motions that no X explains.
std::optional<HandEye> SolveHandEye(std::span<const HandEyePair> pairs);

}  // namespace plenocal
