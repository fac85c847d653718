// SPDX-License-Identifier: Apache-2.0
//
// The request to the simulator: files in and out, options, progress.
#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <string>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// The session to simulate.
struct SimulateRequest {
  std::filesystem::path spec;
  std::filesystem::path out;
  bool points = false;  ///< detections in place of images
};

struct SimulateOptions {
  /// Camera models that the specification may name; plug-ins included.
  std::span<const CameraModel> models;
  std::string program = "plenocal";  ///< as it was called, for the truth's provenance
  int threads = 0;                   ///< 0: all cores
  /// Called with the stage and its items done; false stops (`Stopped` is thrown).
  std::function<bool(const std::string& stage, size_t done, size_t total)> progress;
};

namespace simulate {

/// Reports a stage and its items done; throws `Stopped` where the caller wants to stop.
using Progress = std::function<void(const std::string& stage, size_t done, size_t total)>;

}  // namespace simulate
}  // namespace plenocal
