// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "calib/bundle.h"

namespace plenocal {

/// A combination of unknowns that the data leave open.
struct OpenDirection {
  /// Unknowns with a part in it and their share (largest is 1), largest first: "left.f_x".
  std::vector<std::pair<std::string, double>> parts;
  /// Sigma along it in units of Param::scale; infinite when nothing at all determines it.
  double sigma = 0;
};

/// What the data say about the unknowns of a bundle at its optimum.
struct Uncertainty {
  /// Per camera: sigma of each parameter; 0 for held ones and those at a bound, infinite for those
  /// without any information.
  std::vector<std::vector<double>> params;
  /// Per camera and parameter: its place in `names`; -1 for one that is held, at a bound, or of a
  /// camera without observations. Parameters that are one have one place and one sigma.
  std::vector<std::vector<int>> places;
  /// Per camera: place of the first of its mount's six unknowns in `names`; -1 when not estimated.
  std::vector<int> mount_places;
  /// Per camera: covariance of T_camera_rig in its chart (`Retract`); zero for the master.
  std::vector<Matrix6d> mount;
  /// Per marker: sigma of its coordinates, m; empty when the markers are held.
  std::vector<Eigen::Vector3d> markers;
  /// Covariance (of what is determined) and correlations of all free intrinsics and mounts, in the
  /// order of `names`.
  Eigen::MatrixXd covariance, correlation;
  /// How the best markers follow these unknowns: -d marker / d unknown, three rows a marker; empty
  /// when the markers are held.
  Eigen::MatrixXd marker_gain;
  /// What the frames alone tell of these unknowns, without priors, markers at their best: the
  /// inverse of `covariance` less what priors tell.
  Eigen::MatrixXd frames_information;
  std::vector<std::string> names;
  /// Directions that are not determined: sigma infinite or larger than 1 in natural units.
  std::vector<OpenDirection> open;
  /// Per camera: number of observed coordinates less the unknowns that they pay for.
  std::vector<double> redundancy;
  /// Per camera: how many of the unknowns the means of its markers in each view pay for, not what
  /// the observations of one marker differ by; all of them where a camera sees a marker once.
  std::vector<double> paid_by_means;
  /// Of the jitter's displacements and rotations, each three numbers a view: how many of them the
  /// data tell of. Zeros for a rigid, synchronous rig.
  double jitter_translation_redundancy = 0, jitter_rotation_redundancy = 0;
};

/// Covariance of all unknowns from the reduced (Schur) normal equations, poses eliminated: the same
/// figures as the inverse of the whole J^T J, at a small part of its cost. `camera_names` are used
/// in `names` and `open`. Only used observations count; the loss does not enter, since outliers are
/// rejected before.
Uncertainty EstimateUncertainty(const Bundle& bundle, const std::vector<std::string>& camera_names);

}  // namespace plenocal
