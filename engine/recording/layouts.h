// SPDX-License-Identifier: Apache-2.0
//
// Layouts of recordings by other programs: TUM monoVO, EuRoC, KITTI, folders, archives.
#pragma once

#include <filesystem>

#include "engine/recording/recording_file.h"

namespace plenocal {

/// The parts of a recording. `path` is a recording.yaml, a folder that holds one, a zip archive
/// of images, a recording of messages (MCAP, ROS), a video, or a folder in one of these layouts:
/// - TUM monoVO: images/ or images.zip, times.txt; camera.txt, pcalib.txt, vignette.png
/// - EuRoC: mav0/cam0/data.csv and data/, mav0/cam1 ...
/// - KITTI: image_0/, image_1/ ..., times.txt
/// - any other: a folder or an archive per camera, or names that contain the camera (left01.jpg,
///   right01.jpg); times.txt in the camera's folder, or times_<camera>.txt or times.txt beside.
/// In each, a calibration.yaml beside the images is used as the calibration. Throws `Error` of kind
/// kInput if there are no images.
RecordingFile FindRecordingFile(const std::filesystem::path& path);

}  // namespace plenocal
