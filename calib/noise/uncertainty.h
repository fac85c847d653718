// SPDX-License-Identifier: Apache-2.0
//
// Covariance and standard errors of the unknowns of a bundle at its optimum.
#pragma once

#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// Uncertainty of the unknowns of a bundle at its optimum. Parameters and extrinsics are the
/// intrinsics and T_camera_rig of the cameras.
struct Uncertainty {
  /// Per camera: standard error of each parameter; 0 for fixed ones and those at a bound, infinite
  /// for those without any information.
  std::vector<std::vector<double>> param_std_errors;
  /// Per camera and parameter: its index in `names`; -1 for one that is fixed, at a bound, or of a
  /// camera without observations. Parameters that are tied together have one index.
  std::vector<std::vector<int>> param_index;
  /// Per camera: index of the first of the six unknowns of its extrinsics in `names`; -1 when they
  /// are not estimated.
  std::vector<int> extrinsics_index;
  /// Per target: the same of its pose (`BundleTarget::T_target_own`).
  std::vector<int> target_index = {};
  int scale_index = -1;  ///< first of the targets' scales; -1: there are none
  /// Per camera: covariance of T_camera_rig in its chart (`Retract`); zero for the master.
  std::vector<Matrix6d> extrinsics_covariance;
  /// Per marker: standard errors of its coordinates, m; empty when markers are not estimated.
  std::vector<Eigen::Vector3d> marker_std_errors;
  /// Covariance (in determined directions) and correlations of all free parameters and extrinsics,
  /// in the order of `names`.
  Eigen::MatrixXd covariance, correlation;
  /// Change of the best markers with these unknowns: -d marker / d unknown, three rows a marker;
  /// empty when markers are not estimated.
  Eigen::MatrixXd marker_gain;
  /// Information of the frames alone on these unknowns, without priors, markers at their best: the
  /// inverse of `covariance` less the information of the priors.
  Eigen::MatrixXd frames_information;
  /// Gradient of half the sum of squares of the same; empty with landmarks.
  Eigen::VectorXd frames_gradient;
  std::vector<std::string> names;
  /// Directions that are not determined: standard deviation infinite or larger than 1 in natural
  /// units.
  std::vector<OpenDirection> open;
  /// Columns: those of infinite standard deviation, in the unknowns' own units.
  Eigen::MatrixXd undetermined;
  /// Per camera: number of observed coordinates less the degrees of freedom used by the unknowns.
  std::vector<double> redundancy;
  /// Per camera: degrees of freedom used by view means. The unknowns are determined by the means of
  /// the observations of each marker in each view, and by the differences between these
  /// observations; this is the part of the means, which is all where a camera sees a marker once.
  std::vector<double> degrees_used_by_means;
  /// Number of the jitter's displacements and rotations, each three a view, that the data
  /// determine. Zeros for a rigid, synchronous rig.
  double jitter_translation_redundancy = 0, jitter_rotation_redundancy = 0;
};

/// Covariance of all unknowns from the reduced (Schur) normal equations, poses eliminated: the same
/// figures as the inverse of the whole J^T J, at a small part of its cost. Only used observations
/// count; the loss does not enter, since outliers are rejected before.
Uncertainty EstimateUncertainty(const Bundle& bundle);

/// `EstimateUncertainty` for cameras and targets that the motion places, without views in common:
/// directions that the noise of the poses seems to determine are left open (`Separate`).
Uncertainty EstimateUncertaintyByMotion(const Bundle& bundle);

/// Gives the cameras' unknowns another covariance, and the standard errors that follow.
void SetCovariance(const Eigen::MatrixXd& covariance, Uncertainty* uncertainty);

}  // namespace plenocal
