// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "calib/base/robust.h"
#include "calib/camera/bayer.h"
#include "calib/camera/camera_model.h"
#include "calib/camera/param_rule.h"

namespace plenocal {

/// One camera of session.yaml. Exactly one of `images` and `detections` is given.
struct SessionCamera {
  std::string name;
  const CameraModel* model = nullptr;
  std::string images;               ///< glob, absolute; empty when there is none
  std::string white_images;         ///< likewise
  std::optional<BayerOrder> bayer;  ///< of raw mosaics
  std::filesystem::path detections;
  ImageSize image_size{};                      ///< {0, 0}: taken from the images
  std::vector<double> config;                  ///< the model's config values
  std::vector<std::optional<double>> initial;  ///< per parameter
  std::vector<bool> fixed;                     ///< per parameter
  /// Per parameter, or empty when the session has none; cameras are indices of `Session::cameras`.
  std::vector<ParamRule> rules;
};

/// session.yaml: the cameras to calibrate with their images, target and options (docs/formats.md).
struct Session {
  std::filesystem::path path;
  std::filesystem::path target;
  std::vector<SessionCamera> cameras;  ///< the first is the rig's master
  /// Not set: marker positions are refined when the target has a tolerance.
  std::optional<bool> refine_target;
  Loss loss = Loss::kHuber;
};

/// Reads and checks a session. Throws `Error` with file, line and key.
Session ReadSession(const std::filesystem::path& path, std::span<const CameraModel> models);

}  // namespace plenocal
