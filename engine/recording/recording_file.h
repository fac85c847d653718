// SPDX-License-Identifier: Apache-2.0
//
// Describes the files of a recording before its images are read: as recording.yaml states them
// (docs/formats.md), or as found in the layouts of other programs (layouts.h).
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/files/pairing_key.h"
#include "engine/recording/frames/times.h"
#include "engine/recording/stores/message_log.h"

namespace plenocal {

/// Detections of another program: a text file with columns separated by blanks or commas.
struct MarkerFile {
  std::filesystem::path path;
  std::vector<std::string> columns;  ///< names; those that detections do not have are ignored
  double pixel_origin = 0;           ///< coordinate of the centre of the top-left pixel
  int skip = 0;                      ///< lines before the first row
};

/// Properties of a recorded camera stated in its files.
struct RecordedCameraFacts {
  std::string name;
  std::optional<BayerOrder> bayer = {};   ///< of raw mosaics
  std::optional<double> pixel_size = {};  ///< m
  std::filesystem::path vignetting = {};  ///< image; empty: none
  std::filesystem::path response = {};    ///< pcalib.txt; empty: none
  std::optional<MarkerFile> markers = {};
};

/// The files of a camera of a recording.
struct RecordedFiles : RecordedCameraFacts {
  std::string where;                ///< first words of messages about its images
  std::vector<std::string> images;  ///< globs, folders, files, archives, "archive.zip/folder"
  std::filesystem::path times;      ///< empty: none
  ExposureUnit exposure_unit = ExposureUnit::kMilliseconds;
  std::vector<std::string> white_images;  ///< globs, folders, files
  std::filesystem::path tracks;           ///< scene points followed through the images; empty: none
};

/// A calibration in another program's form.
struct ForeignCalibration {
  std::filesystem::path path;
  std::string format;  ///< for `plenocal import`; empty: it cannot read the file
};

/// Properties of a recording beside its cameras.
struct RecordingFacts {
  std::filesystem::path path;  ///< recording.yaml, or the folder or archive that was given
  /// "recording.yaml", "TUM monoVO", "EuRoC", "KITTI", "folders", "archive",
  /// "MCAP", "ROS 1 bag", "ROS 2 bag" or "video".
  std::string layout;
  std::filesystem::path calibration = {};  ///< calibration.yaml; empty: none
  std::filesystem::path truth = {};        ///< trajectory; empty: none
  /// Calibrations of other programs that lie beside the images, and how to import them.
  std::vector<ForeignCalibration> foreign = {};
  std::shared_ptr<const MessageLog> log = {};   ///< of a recording of messages; else null
  std::vector<ImageTopic> topics = {};          ///< of `log`
  std::vector<MessageTopic> other_topics = {};  ///< of `log`, without images
};

struct RecordingFile : RecordingFacts {
  std::vector<RecordedFiles> cameras = {};
  Pairing pairing = {};
  std::filesystem::path exposures =
      {};  ///< table that replaces exposures in the files of times; empty: none
};

/// Reads recording.yaml. Throws `Error` with file, line and key.
RecordingFile ReadRecordingFile(const std::filesystem::path& path);

}  // namespace plenocal
