// SPDX-License-Identifier: Apache-2.0
//
// Poses and points of a scene from cameras whose parameters are known roughly.
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "engine/scene/scene_start.h"
#include "engine/scene/scene_tracks.h"

namespace plenocal {

/// A scene without its scale, unless the extrinsics of several cameras give it.
struct ReconstructedScene {
  std::vector<BundleCamera> cameras;                        ///< with adjusted parameters
  std::vector<std::optional<RigidTransform>> T_rig_target;  ///< per frame of the tracks
  std::map<int, Eigen::Vector3d> points;                    ///< by number
  size_t frames = 0;                                        ///< with a pose
  double median_residual = 0;  ///< of all observations of these frames and points, px
};

/// From `cameras` (ordinary ones; their parameters are start values) with the tracks of each. One
/// camera starts from the essential matrix of two frames, several with known extrinsics from the
/// frame with most points. Free parameters are adjusted on the way. Throws `Error` of kind kJob
/// when no frames give a start.
ReconstructedScene ReconstructScene(const SceneTracks& tracks,
                                    const std::vector<BundleCamera>& cameras,
                                    const std::optional<CalibrationPrior>& prior);

/// Adjusts robustly what has started and keeps the result as the new start: poses, positions and
/// free parameters. `hold_scale`: nothing gives the scale.
void AdjustStarted(bool hold_scale, SceneState* state);

/// Holds the distance of two landmarks that many frames show, at its present length: nothing else
/// gives the scale.
void HoldScale(Bundle* bundle);

}  // namespace plenocal
