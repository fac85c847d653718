// SPDX-License-Identifier: Apache-2.0
//
// The normal equations of a bundle with landmarks, these eliminated (Schur complement). The poses
// stay, since ground truth needs their covariance.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <span>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/adjust/layout.h"

namespace plenocal {

/// Information on parameters and extrinsics (the first `head` unknowns, in the order of
/// `internal::UnknownLayout`) and on the chart of T_rig_target in each frame.
struct PoseSystem {
  /// Lower triangle; with measured distances and the calibration prior, without `ParamPriors`.
  Eigen::MatrixXd information;
  int head = 0;
  std::vector<int> pose;  ///< per frame: index of its six unknowns; -1: held or not observed
  /// Index of the three unknowns of landmarks that are not eliminated, since a measured distance
  /// ties them to others; -1: eliminated.
  std::vector<int> landmark;

  [[nodiscard]] Eigen::Index Size() const { return information.rows(); }
};

/// REQUIRES: `bundle.HasLandmarks()`, no jitter.
PoseSystem EliminateLandmarks(const Bundle& bundle, const internal::UnknownLayout& layout);

/// Gradients and information of the landmarks along some directions of the unknowns, each landmark
/// at its optimum.
struct LandmarkScores {
  /// Half the gradient of each landmark's sum of squares: a column a landmark. Where each
  /// observation has an error of its own, the covariance of these gradients is the landmark's
  /// information; an error that the observations of a landmark share makes it larger.
  Eigen::MatrixXd gradients;
  std::vector<Eigen::MatrixXd> information;  ///< of the landmarks of each group
};

/// `directions`: unknowns of the system x directions. `group`: of each landmark, from 0 on; any for
/// those without used observations.
LandmarkScores ScoreLandmarks(const Bundle& bundle,
                              const internal::UnknownLayout& layout,
                              const Eigen::MatrixXd& directions,
                              std::span<const int> group);

/// Per camera: degrees of freedom of its used observations that the unknowns use. Poses and
/// landmarks are shared in proportion to the measured coordinates.
std::vector<double> DegreesWithLandmarks(const Bundle& bundle);

}  // namespace plenocal
