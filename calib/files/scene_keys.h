// SPDX-License-Identifier: Apache-2.0
//
// The keys of a session without a target: the scene, and what comes from an earlier calibration.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "calib/base/yaml.h"

namespace plenocal {

/// A measured distance between two scene points.
struct SceneDistance {
  int point_a = 0, point_b = 0;  ///< numbers, as in the tracks
  double length = 0, sigma = 0;  ///< m
  YamlNode place;                ///< of the first point, for messages
};

/// `scene` of session.yaml.
struct SceneKeys {
  int points = 1000;  ///< wanted where points are looked for in images
  std::vector<SceneDistance> distances = {};
};

/// What a camera takes from the session's earlier calibration; indices of parameters.
struct EarlierParams {
  std::optional<std::vector<size_t>> prior = {};  ///< these have a prior; not set: all
  std::vector<size_t> free = {};                  ///< these have a start value alone
  bool free_extrinsics = false;                   ///< so has T_camera_rig
};

/// Reads the map `scene`. Throws `Error` with file, line and key.
SceneKeys ReadSceneKeys(const YamlNode& node);

}  // namespace plenocal
