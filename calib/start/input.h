// SPDX-License-Identifier: Apache-2.0
//
// The input of a calibration: cameras with their observations, markers, targets, priors.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/base/robust.h"
#include "calib/camera/camera_model.h"
#include "calib/camera/micro_lens_array.h"

namespace plenocal {

/// One camera of a calibration: its model and all its observations.
struct CameraInput {
  std::string name;
  const CameraModel* model = nullptr;
  std::vector<double> config;
  std::vector<std::optional<double>> initial;  ///< per parameter: the user's initial value
  std::vector<bool> fixed;                     ///< per parameter: keep it at `initial`
  std::vector<ParamRule> rules = {};           ///< per parameter, or empty
  ImageSize image_size{};
  std::optional<ImageCircle> image_circle = {};  ///< not set: the lens lights the whole image
  std::vector<View> views;
  LatticeErrors lattice_errors = {};  ///< of the micro-image centres in `views`
  /// By frame: when its image was taken, by the camera's clock, s; empty: not known.
  std::map<std::string, double> times = {};
};

/// One of several targets.
struct InputTarget {
  std::string name;
  bool moves = false;                   ///< with respect to all others
  std::optional<RigidTransform> known;  ///< its frame to that of the first target
};

/// Where the estimation starts: a result of the same cameras with other frames.
struct CalibrationStart {
  std::vector<std::vector<double>> params;             ///< per camera, of its model
  std::vector<RigidTransform> T_camera_rig;            ///< per camera
  std::map<std::string, RigidTransform> T_rig_target;  ///< by frame; others are found
  std::map<int, Eigen::Vector3d> markers;              ///< by number, m
};

struct CalibrationInput {
  std::vector<CameraInput> cameras;  ///< the first is the rig's master
  /// By number, m. Of several targets, each in its target's own frame.
  std::map<int, Eigen::Vector3d> markers;
  std::vector<InputTarget> targets = {};  ///< empty: one target
  MarkerFreedom marker_freedom = {};
  std::vector<TargetScale> scales = {};
  std::vector<MarkerDistance> distances = {};  ///< between markers by their numbers
  Loss loss = Loss::kHuber;
  /// From earlier calibrations: the prior of parameters and extrinsics, and T_camera_rig of each
  /// camera (per camera, or empty).
  std::optional<CalibrationPrior> prior = {};
  std::vector<std::optional<RigidTransform>> earlier_T_camera_rig = {};
  /// Only of one target.
  std::optional<CalibrationStart> start = {};
};

}  // namespace plenocal
