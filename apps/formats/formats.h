// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <vector>

#include "apps/formats/camera_format.h"

namespace plenocal {

/// What MATLAB's cameraIntrinsics takes, of one camera.
struct MatlabIntrinsics {
  std::array<double, 2> focal_length, principal_point;  ///< px, (1, 1) at the first pixel's centre
  std::array<double, 2> image_size;                     ///< rows, columns
  std::vector<double> radial_distortion;                ///< three
  std::array<double, 2> tangential_distortion;
};
MatlabIntrinsics ToMatlab(const CalibratedCamera& camera);
/// Two or three radial coefficients.
CalibratedCamera FromMatlab(const MatlabIntrinsics& intrinsics, const std::string& where);

// opencv_files.cc: OpenCV's own YAML
CameraFormat OpenCvFormat();
CameraFormat OrbSlam2Format();
CameraFormat OrbSlam3Format();
// yaml_files.cc: plain YAML and what is read as such (JSON, mrcal's Python dictionaries)
CameraFormat RosFormat();
CameraFormat KalibrFormat();
CameraFormat MrcalFormat();
CameraFormat BasaltFormat();
CameraFormat MatlabFormat();
// text_files.cc: lines of numbers
CameraFormat ColmapFormat();
CameraFormat DsoFormat();
// mat_file.cc: MATLAB's binary files
CameraFormat MatFormat();
// lifcal.cc
CameraFormat LifcalFormat();

}  // namespace plenocal
