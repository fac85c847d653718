// SPDX-License-Identifier: Apache-2.0
//
// From a session, or from images and a target, to a calibration with its verdict and its files.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/estimate/calibrate.h"
#include "calib/files/calibration_record.h"
#include "calib/files/session.h"
#include "engine/observe/session_observations.h"
#include "engine/session/image_session.h"
#include "engine/session/run_folders.h"
#include "engine/session/session_options.h"

namespace plenocal {

/// The input of a calibration: a session, or images and their target.
struct CalibrateRequest : SessionOptions {
  std::optional<Session> session = {};
  ImageArguments images = {};  ///< without a session
  /// The model of `images`, and of cameras in memory that have none; auto: chosen by held-out
  /// frames.
  std::string model = "auto";
  bool jackknife = false;  ///< standard errors from leaving out frames beside the others
  /// Command of the caller, for `provenance` in calibration.yaml.
  std::string command = "plenocal calibrate";
};

struct SessionCalibration {
  Session session;
  Calibration calibration;   ///< without observations
  CalibrationRecord record;  ///< with verdict, target and findings
  /// Micro lenses, vignetting and sample pictures of the cameras.
  std::vector<CameraFile> files;
  std::optional<Target> target = {};    ///< as stated, of several all; nothing of a scene
  std::unique_ptr<RunFolders> folders;  ///< with the result files, to be committed
};

/// Detects, chooses frames and a model where that is asked for, calibrates and judges. Throws
/// `Error`, and `Stopped`.
SessionCalibration CalibrateSession(const CalibrateRequest& request, const Run& run);

}  // namespace plenocal
