// SPDX-License-Identifier: Apache-2.0
//
// What a recording consists of, before its images are looked at: told by recording.yaml
// (docs/formats.md), or found in the layouts of other programs (layouts.h).
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/bayer.h"
#include "calib/files/pairing_key.h"
#include "engine/recording/stores/message_log.h"
#include "engine/recording/times.h"

namespace plenocal {

/// Detections of another program: a text file of columns between blanks or commas.
struct MarkerFile {
  std::filesystem::path path;
  std::vector<std::string> columns;  ///< names; of detections those that they have, others ignored
  double pixel_origin = 0;           ///< coordinate of the centre of the top-left pixel
  int skip = 0;                      ///< lines before the first row
};

/// A camera of a recording.
struct RecordedFiles {
  std::string name;
  std::string where;                ///< begins messages about its images
  std::vector<std::string> images;  ///< globs, folders, files, archives, "archive.zip/folder"
  std::filesystem::path times;      ///< empty: none
  ExposureUnit exposure_unit = ExposureUnit::kMilliseconds;
  std::vector<std::string> white_images;  ///< globs, folders, files
  std::optional<BayerOrder> bayer;
  std::optional<double> pixel_size;  ///< m
  std::filesystem::path vignetting, response;
  std::filesystem::path tracks;  ///< scene points followed through the images; empty: none
  std::optional<MarkerFile> markers;
};

/// A calibration in another program's form.
struct ForeignCalibration {
  std::filesystem::path path;
  std::string format;  ///< as `plenocal import` takes it; empty: none reads it
};

struct RecordingFile {
  std::filesystem::path path;  ///< recording.yaml, or the folder or archive that was looked at
  /// "recording.yaml", "TUM monoVO", "EuRoC", "KITTI", "folders", "archive",
  /// "MCAP", "ROS 1 bag", "ROS 2 bag" or "video".
  std::string layout;
  std::vector<RecordedFiles> cameras = {};
  Pairing pairing = {};
  std::filesystem::path calibration = {}, truth = {};  ///< empty: none
  std::filesystem::path exposures =
      {};  ///< table in place of those in the files of times; empty: none
  std::vector<ForeignCalibration> foreign = {};
  std::shared_ptr<const MessageLog> log = {};   ///< of a recording of messages; else null
  std::vector<ImageTopic> topics = {};          ///< of `log`
  std::vector<MessageTopic> other_topics = {};  ///< of `log`, without images
};

/// Reads recording.yaml. Throws `Error` with file, line and key.
RecordingFile ReadRecordingFile(const std::filesystem::path& path);

}  // namespace plenocal
