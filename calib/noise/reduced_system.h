// SPDX-License-Identifier: Apache-2.0
//
// The normal equations of a bundle with poses eliminated (Schur complement).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "calib/adjust/bundle.h"

namespace plenocal::internal {

/// Index of each unknown in the reduced system: parameters and extrinsics of the cameras first,
/// then three coordinates a marker.
struct UnknownLayout {
  std::vector<std::vector<int>> params;  ///< per camera and parameter; -1 when not estimated
  std::vector<int> extrinsics;           ///< per camera; -1 for the master or a camera without data
  std::vector<int> targets;              ///< per target; -1 where its pose is not estimated
  int head = 0;                          ///< number of unknowns before the markers
  int total = 0;
  bool markers = false;

  [[nodiscard]] int Marker(int index) const { return head + 3 * index; }
};

/// `has_data` per camera: whether it has used observations.
UnknownLayout MakeLayout(const Bundle& bundle, const std::vector<bool>& has_data);

struct ReducedSystem {
  /// Lower triangle of the reduced normal matrix, without priors of parameters.
  Eigen::MatrixXd S;
  /// Per camera: degrees of freedom of its rows that pose and jitter unknowns use; and those that
  /// they use of the means of markers, where these have common noise.
  std::vector<double> degrees_of_poses, degrees_of_poses_by_means;
  /// How many of the jitter's numbers the data determine.
  double jitter_translations = 0, jitter_rotations = 0;
};

ReducedSystem Reduce(const Bundle& bundle, const UnknownLayout& layout);

}  // namespace plenocal::internal
