// SPDX-License-Identifier: Apache-2.0
//
// The numbers of MATLAB's cameraIntrinsics.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// The arguments of MATLAB's cameraIntrinsics, of one camera.
struct MatlabIntrinsics {
  std::array<double, 2> focal_length, principal_point;  ///< px, (1, 1) at the first pixel's centre
  std::array<double, 2> image_size;                     ///< rows, columns
  std::vector<double> radial_distortion;                ///< two or three
  std::array<double, 2> tangential_distortion;
};

MatlabIntrinsics ToMatlab(const CalibratedCamera& camera);
CalibratedCamera FromMatlab(const MatlabIntrinsics& intrinsics, const std::string& where);

}  // namespace plenocal
