// SPDX-License-Identifier: Apache-2.0
//
// Poses of cameras and targets with respect to each other from single views of targets: first by
// views in common, then by motion.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/rigid_transform.h"
#include "calib/rig/hand_eye.h"

namespace plenocal {

/// A target in one image.
struct Sighting {
  int frame = 0;
  size_t camera = 0, target = 0;
  RigidTransform T_camera_target;
};

/// A target's pose as far as it is known before.
struct GraphTarget {
  bool moves = false;  ///< it moves by itself: no pose with respect to others
  /// T_target_own in the frame of the first target that has one; not set: unknown.
  std::optional<RigidTransform> known;
};

/// A step in which cameras or targets were joined.
struct RigLink {
  enum class By { kSameTarget, kSameCamera, kMotion, kEarlier };
  By by = By::kSameTarget;
  std::vector<size_t> cameras;  ///< joined to others by this step; empty: none
  std::vector<size_t> targets;
  size_t frames = 0;  ///< that it uses
};

/// Cameras and targets in groups; a group has one frame, that of its first member.
struct RigGraph {
  std::vector<size_t> camera_group, target_group;  ///< per camera, target
  std::vector<RigidTransform> T_camera_group;      ///< per camera
  std::vector<RigidTransform> T_group_target;      ///< per target
  std::vector<RigLink> links;                      ///< in the order in which they were made
};

/// `earlier`, per camera or empty: T_camera_rig of an earlier calibration. Cameras of which more
/// than the first have one are joined from the start.
RigGraph LinkRig(std::span<const Sighting> sightings,
                 size_t cameras,
                 std::span<const GraphTarget> targets,
                 std::span<const std::optional<RigidTransform>> earlier);

/// The transform that agrees best with the others: the smallest sum of distances, of at most 100
/// tried. REQUIRES: not empty.
RigidTransform Medoid(const std::vector<RigidTransform>& transforms);

}  // namespace plenocal
