// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "apps/simulate/scene/scene_spec.h"
#include "calib/camera/rigid_transform.h"

namespace plenocal::simulate {

/// Which part of a recording a frame belongs to.
enum class Part { kStart, kBetween, kEnd };

/// One instant of a recording.
struct RigInstant {
  std::string name;  ///< "000123": the number at the trajectory's rate
  double time = 0;   ///< s
  Part part = Part::kBetween;
  bool used = false;  ///< images or tracks are made of it
  RigidTransform T_world_rig;
  Eigen::Vector3d velocity{0, 0, 0};  ///< m/s, of the rig
};

/// The rig's path; the world's z axis points up.
struct RigPath {
  std::vector<RigInstant> instants;
  double circumference = 0;  ///< m, of a loop about the world's z axis; 0: another path

  [[nodiscard]] std::vector<const RigInstant*> Used() const;
};

/// The path of a specification, all from the seed. `nearest`: m, of the scene's points.
///
/// A loop runs around a circle (or two straight sides with half circles between them), the rig
/// looks outwards. It ends past its start, so that the end covers the start's path again. The
/// winding moves the rig up and down and, half as far, towards the scene and back; the hand's shake
/// comes in addition.
RigPath MakeRigPath(const TrajectorySpec& spec, double nearest, double farthest, int seed);

}  // namespace plenocal::simulate
