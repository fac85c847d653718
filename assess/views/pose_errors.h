// SPDX-License-Identifier: Apache-2.0
//
// Covariance of the poses of a calibration's frames.
#pragma once

#include <map>

#include "calib/files/calibration_record.h"
#include "calib/rig/outside_poses.h"

namespace plenocal {

/// Errors of a calibration's poses, per index of a frame whose pose its points determine: those
/// that all poses share are the errors of parameters, extrinsics and target. Throws as
/// `MakeRigEstimate`.
std::map<int, PoseErrors> ComputePoseErrors(const CalibrationRecord& calibration);

}  // namespace plenocal
