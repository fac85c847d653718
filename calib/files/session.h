// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "calib/bundle.h"
#include "calib/camera_model.h"
#include "calib/param_rule.h"

namespace plenocal {

/// An image file and the frame that it belongs to.
struct FrameImage {
  std::string frame;
  std::filesystem::path path;
};

/// One camera of session.yaml. Exactly one of `images` and `detections` is given.
struct SessionCamera {
  std::string name;
  const CameraModel* model = nullptr;
  std::string images;        ///< glob, absolute; empty when there is none
  std::string white_images;  ///< likewise
  std::string bayer;         ///< "RGGB" and the like for raw mosaics, else empty
  std::filesystem::path detections;
  ImageSize image_size{};                      ///< {0, 0}: taken from the images
  std::vector<double> config;                  ///< the model's config values
  std::vector<std::optional<double>> initial;  ///< per parameter
  std::vector<bool> fixed;                     ///< per parameter
  /// Per parameter, or empty when the session has none; places refer to `Session::cameras`.
  std::vector<ParamRule> rules;
};

/// session.yaml: what to calibrate (FORMATS.md).
struct Session {
  std::filesystem::path path;
  std::filesystem::path target;
  std::vector<SessionCamera> cameras;  ///< the first is the rig's master
  /// Not set: the markers are refined when the target states a tolerance.
  std::optional<bool> refine_target;
  Loss loss = Loss::kHuber;
};

/// Reads and checks a session. Throws `Error` with file, line and key.
Session ReadSession(const std::filesystem::path& path, std::span<const CameraModel> models);

/// Files that match a glob, sorted by name, each with its frame's name: what the last `*` stands
/// for, or the file's name without extension where the pattern has none. Throws `Error` when
/// nothing matches or two files belong to one frame; `what` ("left: images") goes into the message.
std::vector<FrameImage> ExpandImages(const std::string& pattern, const std::string& what);

}  // namespace plenocal
