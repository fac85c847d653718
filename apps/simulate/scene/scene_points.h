// SPDX-License-Identifier: Apache-2.0
//
// The points of a simulated scene and their tracks in the cameras.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/simulate/scene/scene_shape.h"

namespace plenocal::simulate {

/// A point on a surface of the scene.
struct ScenePoint {
  Eigen::Vector3d position{0, 0, 0}, normal{0, 0, 0};  ///< m; of the world or of its box
  std::optional<std::size_t> box;                      ///< the moving box that it lies on
  int number = 0;                                      ///< marker number in tracks
  /// Its number in the end segment; none: it is not tracked there. Another number than `number`
  /// stands for a point that was not recognised, or was mistaken for another.
  std::optional<int> number_at_end = 0;
};

/// The points of a scene, all from the seed: what the used frames show, even in images and in 1 /
/// depth. Throws `Error` of kind kJob when the cameras see no surface between `near` and `far`.
std::vector<ScenePoint> DrawPoints(const SimulationSpec& spec,
                                   const Observer& observer,
                                   const RigPath& path,
                                   const SimulatedScene& scene);

/// The tracks of one camera.
struct CameraTracks {
  std::vector<View> views;  ///< of the used frames, with noise
  /// Frame and marker of the observations that are another point's.
  std::vector<std::pair<std::string, int>> wrong;
  std::vector<int> observed;  ///< by point, in how many frames
};

CameraTracks TrackPoints(const SimulationSpec& spec,
                         const Observer& observer,
                         const RigPath& path,
                         const SimulatedScene& scene,
                         const std::vector<ScenePoint>& points,
                         std::size_t camera,
                         int threads);

}  // namespace plenocal::simulate
