// SPDX-License-Identifier: Apache-2.0
//
// The normal equations of a bundle with poses eliminated, and the degrees of freedom of these.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/adjust/layout.h"

namespace plenocal::internal {

struct ReducedSystem {
  /// Lower triangle of the reduced normal matrix, without priors of parameters.
  Eigen::MatrixXd S;
  /// Gradient of half the sum of squares by the same unknowns; priors of markers are left out.
  Eigen::VectorXd gradient;
  /// Per camera: degrees of freedom of its rows that pose and jitter unknowns use; and those that
  /// they use of the means of markers, where these have common noise.
  std::vector<double> degrees_of_poses, degrees_of_poses_by_means;
  /// Per frame: covariance of its pose, all unknowns of the layout fixed.
  std::vector<Matrix6d> pose_covariances;
  /// Numbers of the jitter that the data determine.
  double jitter_translations = 0, jitter_rotations = 0;
};

ReducedSystem Reduce(const Bundle& bundle, const UnknownLayout& layout);

}  // namespace plenocal::internal
