// SPDX-License-Identifier: Apache-2.0
//
// Calibration from scene points without nominal positions: the shared bundle adjustment with
// landmarks in place of a target's markers.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/estimate/calibrate.h"
#include "calib/files/scene_keys.h"
#include "calib/prior/earlier_cameras.h"

namespace plenocal {

struct SceneCalibrationInput {
  EarlierCameras cameras;
  std::vector<SceneDistance> distances;
  std::optional<SceneTags> tags = {};  ///< their sizes give distances, too
  Loss loss = Loss::kHuber;
  /// A track and an earlier camera's that looks like the same point, to about a pixel: used for the
  /// initial guess alone.
  std::vector<std::pair<int, int>> alike = {};
  bool from_images = false;  ///< the tracks are patches followed through images
};

/// Throws `Error` of kind kInput for distances between points that no two views show, and of kind
/// kJob when the tracks do not give a start. Where nothing gives the scale, the bundle has a
/// `scale_distance`, and lengths have infinite standard errors.
Calibration CalibrateScene(const SceneCalibrationInput& input, const CalibrationOptions& options);

/// The landmarks with used observations as ASCII PLY with their numbers.
std::string ScenePointsPly(const Calibration& calibration);

}  // namespace plenocal
