// SPDX-License-Identifier: Apache-2.0
//
// Summary of a recording, the output of `plenocal recording`.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/camera_model.h"
#include "engine/recording/recording.h"

namespace plenocal {

/// Missing images: an interval that is larger than the usual one.
struct Gap {
  std::string after;   ///< name of the image before
  size_t missing = 0;  ///< images that fit into the interval
};

struct ExposureSummary {
  double least = 0, largest = 0;  ///< ms
  size_t changes = 0;             ///< images whose exposure is not that of the image before
  double largest_step = 1;        ///< the largest ratio of two successive exposures, >= 1
};

struct CameraSummary {
  std::string name;
  std::optional<std::vector<Gap>> gaps;     ///< nothing: without times and numbers of images
  std::optional<ExposureSummary> exposure;  ///< nothing: not known
  [[nodiscard]] size_t Missing() const;
};

/// Pairing of a camera with the first one.
struct PairSummary {
  std::string camera;
  size_t frames = 0;               ///< that have images of both
  double median = 0, largest = 0;  ///< s, absolute differences of the times; 0 without times
};

/// Data that a recording lacks for a command, in words; empty: the command can run.
struct CommandNeeds {
  std::string command;
  std::vector<std::string> lacks;
};

struct RecordingSummary {
  size_t complete = 0;            ///< frames with an image of each camera
  double duration = 0, rate = 0;  ///< s, frames per second by the usual interval; 0 without times
  std::vector<CameraSummary> cameras;
  std::vector<PairSummary> pairs;
  std::vector<CommandNeeds> needs;
};

/// Summarises a recording. Reads its calibration too, whose camera models must be in `models`.
/// Throws `Error` of kind kInput if the calibration cannot be read.
RecordingSummary Summarise(const Recording& recording, std::span<const CameraModel> models);

/// The summary for the terminal.
std::string SummaryText(const Recording& recording, const RecordingSummary& summary);

/// The same as JSON (docs/formats.md).
std::string SummaryJson(const Recording& recording, const RecordingSummary& summary);

}  // namespace plenocal
