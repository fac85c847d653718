// SPDX-License-Identifier: Apache-2.0
//
// Poses with their standard errors in words.
#pragma once

#include <string>

#include "calib/camera/rigid_transform.h"

namespace plenocal {

/// "(x, y, z) +- (...) mm, <rotation>(...) +- (...) degrees" of a translation (m) and a rotation
/// vector (rad), both in `pose`, and their standard errors.
std::string PoseText(const Vector6d& pose, const Vector6d& sigma, const std::string& rotation = {});

}  // namespace plenocal
