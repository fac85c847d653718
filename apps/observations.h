// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/console.h"
#include "calib/output_folder.h"
#include "calib/session.h"
#include "calib/stage_store.h"
#include "calib/start.h"
#include "targets/target.h"

namespace plenocal {

/// A file that belongs to a camera of a result: `key: name` in its part of calibration.yaml.
struct CameraFile {
  size_t camera = 0;
  std::string key, name, content;
};

/// All observations of a session's cameras, from their images or detection files.
struct SessionObservations {
  std::vector<CameraInput> cameras;
  /// Micro lenses and vignetting of plenoptic cameras, pictures of a sample frame.
  std::vector<CameraFile> files;
  std::vector<std::string> sample_frames;  ///< per camera; empty: there is no picture
  std::vector<LeftOut> left_out;
};

/// Where `CollectObservations` keeps what it makes on the way.
struct DetectionPlaces {
  StageStore* store = nullptr;       ///< detections for later runs; null: nowhere
  OutputFolder* pictures = nullptr;  ///< images/<camera>/...; null: none are made
};

/// Detections that runs into the folder `out` keep for each other: those of this program and the
/// session's target.
StageStore OpenStageStore(const std::filesystem::path& out, const Session& session, bool fresh);

/// Reads or detects them, tells `console` one line a camera, and throws `Stopped` after Ctrl-C.
/// Throws `Error` when no camera of the session sees the target.
SessionObservations CollectObservations(const Session& session,
                                        const Target& target,
                                        const ConsoleOptions& options,
                                        const DetectionPlaces& places,
                                        Console* console);

/// Throws `Error` when a result in folder `out`, one of `results` or a camera's detections, would
/// take the place of a file that the session reads. Only detections that are read from where they
/// would be written are allowed: `WriteDetections` leaves them alone.
void RefuseToReplaceInputs(const Session& session,
                           const std::filesystem::path& out,
                           std::vector<std::string> results);

/// Writes detections_<camera>.csv of each camera and the cameras' files.
void WriteDetections(const Session& session,
                     const SessionObservations& observations,
                     const std::filesystem::path& folder,
                     OutputFolder* out);

}  // namespace plenocal
