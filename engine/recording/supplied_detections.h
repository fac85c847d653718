// SPDX-License-Identifier: Apache-2.0
//
// Reads detections and intrinsics of other programs that lie beside a recording.
#pragma once

#include <cstddef>
#include <string>

#include "calib/base/run.h"
#include "calib/io/output_folder.h"
#include "engine/recording/recording.h"

namespace plenocal {

/// Detections of another program as a detections CSV (docs/formats.md).
struct SuppliedDetections {
  std::string csv;
  size_t points = 0;       ///< rows
  size_t left_out = 0;     ///< rows of images that the recording does not have
  int first_left_out = 0;  ///< line of the first of these
};

/// Reads the supplied detections of a camera that has some (`RecordedCamera::markers`). Frames have
/// the names of the recording, and (0, 0) is the centre of the top-left pixel. Throws `Error` of
/// kind kInput with file and line for an invalid number, two rows of one point, and a file without
/// any image of the camera.
SuppliedDetections ReadSuppliedDetections(const Recording& recording, size_t camera);

/// detections_<camera>.csv of all cameras with supplied detections. Throws `Error` of kind kInput
/// if there is no such camera.
OutputContents SuppliedMarkers(const Recording& recording, const Run& run);

/// camera_info_<camera>.yaml as in ROS, from the intrinsics beside the images. Throws `Error` of
/// kind kInput if there are none.
OutputContents CameraInfoFiles(const Recording& recording, const Run& run);

}  // namespace plenocal
