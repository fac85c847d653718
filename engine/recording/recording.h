// SPDX-License-Identifier: Apache-2.0
//
// A recording: the images of one or more cameras in the order in which they were taken, with times
// and exposures where they are known (docs/recordings.md).
#pragma once

#include <cstddef>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/observation.h"
#include "calib/files/frame_images.h"
#include "engine/recording/recording_file.h"

namespace plenocal {

struct RecordedImage : FrameImage {
  std::optional<double> exposure = {};  ///< ms
};

struct RecordedCamera : RecordedCameraFacts {
  std::vector<RecordedImage> images = {};  ///< by time, without times by name
  ImageSize image_size{};
  std::vector<FrameImage> white_images = {};
  size_t exposures_filled = 0;  ///< images whose exposure is the mean of their neighbours'

  /// The image as single-channel grey of the file's own depth, 8 or 16 bits; a raw mosaic as it is.
  /// Throws `Error` of kind kInput, with the file's name, if it is damaged.
  [[nodiscard]] cv::Mat Read(size_t index) const;
};

/// The images of one instant.
struct RecordedFrame {
  std::string name;                          ///< of the image of its first camera that has one
  double time = 0;                           ///< s, of the same image; NaN: not known
  std::vector<std::optional<size_t>> image;  ///< per camera, index of its images
};

struct Recording : RecordingFacts {
  Pairing::By paired_by{};  ///< how the frames were made
  double tolerance = 0;     ///< s, of the pairing by time
  std::vector<RecordedCamera> cameras = {};
  std::vector<RecordedFrame> frames = {};  ///< in the order of the recording; names are unique
  std::vector<LeftOut> left_out = {};      ///< images that cannot be used
  std::vector<std::string> notes = {};     ///< unusual properties of its files, in sentences

  [[nodiscard]] bool HasTimes() const;
  [[nodiscard]] const RecordedCamera* FindCamera(const std::string& name) const;
};

/// Reads a recording: a recording.yaml, a folder that holds one or whose layout is known, or a zip
/// archive with images. First completes results of a killed run in it (calib/io/output_folder.h).
/// Reads only the headers of the images, and three whole images per camera to find raw mosaics.
///
/// Throws `Error` of kind kInput, with file and line where there is one: no images, times that do
/// not increase or do not belong to the images, different numbers of images without times, a raw
/// mosaic that is not stated as one. Images that cannot be used are in `left_out`: of another size
/// than most, without a readable header, without a time.
Recording ReadRecording(const std::filesystem::path& path);

}  // namespace plenocal
