// SPDX-License-Identifier: Apache-2.0
//
// Initial poses and landmarks of a scene that calibrated cameras have seen: frame by frame from
// the points that are known already (P3P in a least-median search), and points from the rays of
// the frames that are.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal {

/// A bundle with landmarks whose poses and positions are being found.
struct SceneState {
  Bundle* bundle = nullptr;
  std::vector<bool> has_pose;                        ///< per frame
  std::vector<bool> has_point;                       ///< per marker
  std::vector<std::vector<size_t>> observations_of;  ///< per marker, indices in the bundle's order
  /// Least angle between the rays of a new point, rad. Cameras with calibrated extrinsics need less
  /// than those whose first poses are guessed.
  double least_parallax = 1.0 / 60;
};

SceneState MakeSceneState(Bundle* bundle);

/// A frame's pose from the points known so far.
struct PoseSearch {
  RigidTransform T_rig_target;
  size_t inliers = 0;     ///< landmarks that agree
  size_t candidates = 0;  ///< landmarks with a position that the frame shows
  double sigma = 0;       ///< robust, of one coordinate of the inliers' residuals, px
};

/// A wrong pose agrees with three by its making, and hardly with so many more by chance.
inline constexpr size_t kFewestAgreeing = 12;
/// Nothing when fewer than `kFewestLandmarks` are known or most of them contradict each other
/// (least median). With `limit`, the residual in px below which a landmark agrees, most may: the
/// pose with the most that agree wins, and nothing is found below `fewest_agreeing`. The search is
/// deterministic.
std::optional<PoseSearch> FindPose(const SceneState& state,
                                   size_t frame,
                                   std::optional<double> limit = std::nullopt,
                                   size_t fewest_agreeing = kFewestAgreeing);
inline constexpr size_t kFewestLandmarks = 8;

/// Positions of the landmarks that `frame` shows and that have none: from the rays of its cameras,
/// where several see the point, else also from those of the first frame with a pose that shows it.
/// A point counts when it lies in front of the cameras and its residuals, in px, are below
/// `largest_residual`.
void Triangulate(size_t frame, double largest_residual, SceneState* state);

/// Poses of `frames`, in this order; the first of them has its pose already, or gets the identity
/// when no landmark is known. A frame without a pose is left out. Returns the last frame's limit of
/// the residuals of good points, px.
double FollowFrames(const std::vector<size_t>& frames, SceneState* state);

/// Lengths of the residuals of observations with the present poses and positions, px.
double ResidualLength(const Bundle& bundle, const BundleObservation& observation);

/// Residual below which an observation agrees with the present poses and positions, px: three
/// robust sigmas of all used ones; 0 when there are none.
double ResidualLimit(const SceneState& state);

/// Factor from the present distances of landmarks to those that the rays of single views show, of a
/// plenoptic camera without ordinary ones: their median. Nothing when no view shows one.
std::optional<double> ScaleByOwnDistances(const SceneState& state);

/// Poses of all frames that the landmarks known so far reach, the frame with most of them first;
/// `posed` is called after each with the number of frames that have a pose, which is returned.
size_t FollowByOverlap(const std::function<void(size_t)>& posed, SceneState* state);

/// Leaves in the bundle the observations of frames with a pose and of landmarks with a position.
void KeepStarted(const SceneState& state, Bundle* bundle);

}  // namespace plenocal
