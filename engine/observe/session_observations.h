// SPDX-License-Identifier: Apache-2.0
//
// The observations of a session's cameras, as `calibrate`, `detect`, `try` and `compare` need them.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/files/session.h"
#include "calib/io/detection_cache.h"
#include "calib/io/output_folder.h"
#include "calib/start/camera_guess.h"
#include "calib/traits/image_traits.h"
#include "engine/session/session_targets.h"
#include "targets/target.h"

namespace plenocal {

/// A result file of one camera, which calibration.yaml lists as `key: name`.
struct CameraFile {
  size_t camera = 0;
  std::string key, name, content;
};

/// All observations of a session's cameras, from their images or detection files.
struct SessionObservations {
  std::vector<CameraInput> cameras;
  std::vector<CameraFile>
      files;  ///< micro lenses and vignetting of plenoptic cameras, pictures of a sample frame
  std::vector<std::string> sample_frames;  ///< per camera: the frame of the pictures; empty: none
  std::vector<CameraTraits> traits;        ///< per camera: what its images show beside markers
  std::vector<std::vector<BlurMeasurement>> blurs;  ///< per camera: in the micro images
  std::vector<LeftOut> left_out;                    ///< images and markers, with reasons
};

/// Destinations of the intermediate results of `CollectObservations`.
struct DetectionPlaces {
  DetectionCache* cache = nullptr;   ///< detections for later runs; null: not kept
  OutputFolder* pictures = nullptr;  ///< pictures of the stages, images/<camera>/...; null: none
};

/// Reads the detection files of a session and detects the target in its images; prints one line per
/// camera. Throws `Error` when the images of a camera show no target, and `Stopped` after Ctrl-C.
SessionObservations CollectObservations(const Session& session,
                                        const Target& target,
                                        const Run& run,
                                        const DetectionPlaces& places);
/// The same of several targets, whose markers have the numbers of `SessionTargets::all`. Targets
/// that look alike are told apart. Detections of several are not kept for later runs.
SessionObservations CollectObservations(const Session& session,
                                        const SessionTargets& targets,
                                        const Run& run,
                                        const DetectionPlaces& places);

/// Writes detections_<camera>.csv of each camera, unless it was read from there, and the cameras'
/// files.
void WriteDetections(const Session& session,
                     const SessionObservations& observations,
                     const std::filesystem::path& folder,
                     OutputFolder* out);

}  // namespace plenocal
