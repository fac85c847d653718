// SPDX-License-Identifier: Apache-2.0
//
// Influence of single frames: the change of a calibration without them.
#pragma once

#include <string>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// Change of a calibration without one frame.
struct FrameInfluence {
  int frame = 0;
  double sigmas = 0;    ///< largest change of a parameter or extrinsic, in its standard errors
  std::string unknown;  ///< the one that changes most: "left.f_x", "right.T_camera_rig.x"
};

/// By one Newton step from the adjustment, (S - S_f)^-1 J_f' W r_f with the information S of all
/// frames and S_f of this one; poses are eliminated, outliers stay what they are. Frames without a
/// used point are left out. Throws as `MakeRigEstimate`.
std::vector<FrameInfluence> FrameInfluences(const CalibrationRecord& calibration);

}  // namespace plenocal
