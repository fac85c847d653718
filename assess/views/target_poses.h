// SPDX-License-Identifier: Apache-2.0
//
// Poses of a target that a person with a camera can make, to choose the next views from.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "assess/views/rig_estimate.h"

namespace plenocal {

/// Distances within which the target is moved, m.
struct ViewRange {
  double nearest = 0, farthest = 0;
};

/// A pose by what a person does with the target before one camera.
struct TargetPose {
  size_t camera = 0;
  Eigen::Vector2d place{0, 0};  ///< image of the target's middle, px; may lie beyond the border
  double distance = 0;          ///< of its middle from the camera, m
  double tilt = 0;              ///< angle between its normal and the line of sight, rad
  /// Direction in the image, from x to y, in which the side of the target lies that is tilted away
  /// from the camera, rad.
  double away = 0;
  double turn = 0;  ///< about its normal, rad
};

/// From the distance at which the target's extent fills the camera's image to the one at which its
/// finest detail is resolved no more; of a plenoptic camera, and where `seen` (ascending, m) has
/// distances, no more than `kBeyondSeen` times beyond those. `wanted` narrows it where not 0.
/// Throws `Error` of kind kInput when nothing is left.
ViewRange FeasibleRange(const RigEstimate& rig,
                        size_t camera,
                        const ViewTarget& shape,
                        const std::vector<double>& seen,
                        const ViewRange& wanted);

/// A grid of poses before one camera: places over the image (and beyond its border for a target
/// that is found in part), distances in equal steps of 1 / z, tilts up to `largest_tilt` rad to
/// eight sides, upright and turned by 90 degrees.
std::vector<TargetPose> CandidatePoses(const RigEstimate& rig,
                                       size_t camera,
                                       const ViewTarget& shape,
                                       const ViewRange& range,
                                       double largest_tilt);

inline constexpr size_t kNeighbours = 12;
/// A pose with one of its six numbers changed: the image's x and y, distance, tilt, direction,
/// turn; larger of an even `neighbour`, smaller of an odd one. `step`: part of the candidates'
/// distance.
TargetPose NeighbourPose(TargetPose pose,
                         size_t neighbour,
                         double step,
                         ImageSize image_size,
                         const ViewRange& range,
                         double largest_tilt);

/// Pose of the largest value near another one, by steps from neighbour(pose, k, step) to the next
/// one: 1, 1/2 and 1/4 of the candidates' distance along each number in turn.
TargetPose LargestNearby(
    TargetPose pose,
    const std::function<TargetPose(const TargetPose&, size_t, double)>& neighbour,
    const std::function<double(const TargetPose&)>& value);

/// T_camera_target of a pose; nothing where the camera has no ray to its place.
std::optional<RigidTransform> PlaceTarget(const RigEstimate& rig,
                                          const ViewTarget& shape,
                                          const TargetPose& pose);

/// Poses as they come out when a person carries one out: with errors of `angle` rad, and of `part`
/// of the distance.
std::vector<RigidTransform> ExecutedPoses(const RigidTransform& T_camera_target,
                                          const ViewTarget& shape,
                                          double angle,
                                          double part);

/// Whether a person sees two poses as different: by another camera, more than 20 degrees between
/// their normals, another turn, a fifth of the distance or a third of the image.
bool LookDifferent(const TargetPose& a, const TargetPose& b, ImageSize image_size);

/// Middle of the target's markers.
Eigen::Vector3d MiddleOf(const ViewTarget& shape);

}  // namespace plenocal
