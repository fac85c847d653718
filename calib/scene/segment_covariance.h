// SPDX-License-Identifier: Apache-2.0
//
// Uncertainty of the ground truth of a loop: the covariance of the end segment's poses in the frame
// of the start segment.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal {

using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;

/// Change of a camera's path by a small similarity about `centre`: position p moves by
/// d + w x (p - centre) + s (p - centre), with [d, w, s] the seven numbers.
Eigen::Matrix<double, 3, 7> SimilarityEffect(const Eigen::Vector3d& p,
                                             const Eigen::Vector3d& centre);

/// A segment of a camera's path.
struct PathSegment {
  std::vector<Eigen::Vector3d> positions;  ///< of the camera, in the landmarks' frame, m
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  /// Singular values of the centred positions over the root of their number, largest first: extent
  /// along the principal directions, m.
  Eigen::Vector3d extent = Eigen::Vector3d::Zero();

  /// The small similarity about `centre` that fits changes `dp` of the positions best.
  [[nodiscard]] Vector7d Fit(std::span<const Eigen::Vector3d> dp) const;
};

/// Path of camera `camera` in these frames.
PathSegment MakeSegment(const Bundle& bundle, size_t camera, std::span<const size_t> frames);

/// Covariance of both segments of a loop.
struct LoopCovariance {
  /// Covariance of the small similarities [start, end] of the segments about their centres, each
  /// translation (m), rotation (rad), scale.
  Eigen::Matrix<double, 14, 14> segments;
  double scale_sigma = 0;  ///< of the whole truth's scale
  /// Factor on the variances for errors that the observations of one track share (a patch that
  /// looks different from another side) and those of its neighbours (overlapping patches, one
  /// wall): the gradients of the tracks scatter more than the noise of single observations
  /// explains. It is in all covariances here.
  double track_factor = 1;
  /// Per frame of the bundle: covariance of T_world_rig's se(3) vector relative to the fixed frame;
  /// zero for that frame and for frames that were not observed.
  std::vector<Matrix6d> poses;

  /// Covariance of the end segment's similarity less that of the start.
  [[nodiscard]] Matrix7d Relative() const;
  /// Root mean square displacement of the positions `path` between the alignments with both
  /// segments that their errors alone cause: e_align of a perfect estimate, m.
  [[nodiscard]] double AlignmentFloor(const PathSegment& start,
                                      const PathSegment& end,
                                      std::span<const Eigen::Vector3d> path) const;
};

/// At the optimum of a bundle with landmarks; segments of camera `camera`. The covariance is that
/// of the adjustment, and in no direction smaller than what the scatter of the tracks' gradients
/// gives (the "sandwich" with a cluster a track: Liang and Zeger, Biometrika 73, 1986), widened by
/// what the scatter of groups of neighbouring tracks gives more, and as few tracks demand. Throws
/// `Error` of kind kJob when the observations do not determine all poses.
LoopCovariance EstimateLoopCovariance(const Bundle& bundle,
                                      size_t camera,
                                      std::span<const size_t> start,
                                      std::span<const size_t> end);

}  // namespace plenocal
