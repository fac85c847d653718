// SPDX-License-Identifier: Apache-2.0
//
// Detections and intrinsics that other programs have put beside a recording.
#pragma once

#include <cstddef>
#include <string>

#include "calib/base/run.h"
#include "calib/io/output_folder.h"
#include "engine/recording/recording.h"

namespace plenocal {

/// Supplied detections as a detections CSV (docs/formats.md).
struct SuppliedDetections {
  std::string csv;
  size_t points = 0;       ///< rows
  size_t left_out = 0;     ///< rows of images that the recording does not have
  int first_left_out = 0;  ///< line of the first of these
};

/// Reads the supplied detections of a camera that has some (`RecordedCamera::markers`). Frames are
/// called as in the recording, pixels count from the centre of the top-left one. Throws `Error` of
/// kind kInput with file and line for what is no number, two rows of one point, and a file that
/// names no image of the camera.
SuppliedDetections ReadSuppliedDetections(const Recording& recording, size_t camera);

/// detections_<camera>.csv of all cameras with supplied detections. Throws `Error` of kind kInput
/// where there is none.
OutputContents SuppliedMarkers(const Recording& recording, const Run& run);

/// camera_info_<camera>.yaml, as ROS has them, of the intrinsics beside the images. Throws `Error`
/// of kind kInput where there are none.
OutputContents CameraInfoFiles(const Recording& recording, const Run& run);

}  // namespace plenocal
