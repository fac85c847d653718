// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "apps/formats/camera_format.h"

namespace plenocal {

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
// lifcal.cc
CameraFormat LifcalFormat();

}  // namespace plenocal
