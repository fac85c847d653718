// SPDX-License-Identifier: Apache-2.0
//
// Estimate of a rig before its next view is taken: the state of an adjustment and the frames so
// far, from the files of a calibration.
#pragma once

#include <Eigen/Core>
#include <map>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/camera/micro_lens_array.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// A target as views measure it: its points, and the detail that an image must resolve.
struct ViewTarget {
  std::map<int, Eigen::Vector3d> markers;  ///< by number, m
  /// Unit vectors from the markers to the viewer of the printed side; zero: visible from
  /// everywhere.
  std::map<int, Eigen::Vector3d> normals = {};
  std::vector<std::vector<Eigen::Vector3d>> outlines = {};  ///< of the flat parts, m
  double finest = 0;  ///< m, the detail that an image must resolve; 0: there is none
  /// It is found where only a part of it is in the image: tags, ChArUco boards.
  bool found_in_part = false;
};

/// Parameters, extrinsics and the frames so far. Only parameters that are not `fixed` are unknowns.
struct RigEstimate {
  Bundle bundle;
  /// Per camera: standard deviation of a coordinate of one observation, px.
  std::vector<double> sigma_px;
  /// Per camera: variance of its unknowns over that from independent points (`CommonErrors`).
  std::vector<double> factors;
  /// Per camera: the micro lenses of a plenoptic one, else none.
  std::vector<MicroLensArray> lenses;
  /// Standard errors of the markers' coordinates, m, by number; empty: they are exact.
  std::map<int, Eigen::Vector3d> marker_sigmas;
};

/// The estimate in the files of a calibration. Parameters of standard error 0 are fixed;
/// the session's priors are not in the files, so that what they add is left out. `lenses` stays
/// empty, and factors are 1 (`SetFactors`). Throws `Error` of kind kInput for a calibration without
/// a target, without residuals, or with a model of so many local parameters that one view
/// determines few of them.
RigEstimate MakeRigEstimate(const CalibrationRecord& calibration);

/// The free parameters and extrinsics of a rig in one vector, and, where markers are refined, the
/// deformations of the target that all its markers share. Cameras without points are in it.
struct RigUnknowns {
  std::vector<std::vector<int>> params;  ///< per camera and parameter; -1: fixed
  std::vector<int> extrinsics;           ///< per camera, the first of six; -1: the rig's frame
  Eigen::Index head = 0;                 ///< number of unknowns before those of the target
  /// Natural size of each: of a parameter, of the target's distance, of a deformation before any
  /// image.
  Eigen::VectorXd unit;
  /// Per marker: its displacement by one unit of each deformation of the target, m.
  std::map<int, Eigen::Matrix3Xd> deformations;
  std::vector<std::string> names;  ///< "left.f_x", "right.T_camera_rig.x"
};

/// `distance`: typical of the target, m. Deformations are the linear ones (its scale is one: no
/// view tells it from the baselines of a rig) and the bends of a plane. They are what frames cannot
/// average out: single markers are known after a few frames.
RigUnknowns MakeRigUnknowns(const Bundle& bundle, double distance);

/// The unit of each unknown times the root of its camera's factor.
Eigen::VectorXd UnknownScales(const RigEstimate& rig, const RigUnknowns& unknowns);

/// Distances of the used points from a camera, m, ascending.
std::vector<double> PointDistances(const Bundle& bundle, size_t camera);

/// Distances at which the projection of a rig is assessed, m: the nearest and the farthest of its
/// used points and, without a plenoptic camera, ten times the farthest.
std::vector<double> ProjectionDistances(const Bundle& bundle);

}  // namespace plenocal
