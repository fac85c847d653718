// SPDX-License-Identifier: Apache-2.0
//
// Readers of rigid transforms in files, with checks.
#pragma once

#include "calib/camera/rigid_transform.h"
#include "calib/io/yaml.h"

namespace plenocal {

/// Replaces a matrix that is a rotation but for its few digits by a rotation; one with all digits
/// stays as it is. False for a matrix that is none.
bool MakeRotation(Eigen::Matrix3d* R);

/// Largest distance between parts of a rig and its targets, m.
inline constexpr double kFarthestPart = 1e6;

/// A 4 x 4 matrix, row by row; its rotation may have few digits. Throws `Error` with file, line and
/// key.
RigidTransform ReadTransform(const YamlNode& node);
/// The transform of an se(3) vector. Throws likewise.
RigidTransform ReadXi(const YamlNode& node);

}  // namespace plenocal
