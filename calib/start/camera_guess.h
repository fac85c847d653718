// SPDX-License-Identifier: Apache-2.0
//
// Initial guess of single cameras.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/camera/camera_model.h"
#include "calib/start/input.h"

namespace plenocal {

/// The camera in a bundle with these parameters: those that its model fixes, or gives by the others
/// where the input does not state them, are fixed; the model's priors are rules where the input has
/// none.
BundleCamera MakeBundleCamera(const CameraInput& camera, std::vector<double> params);

/// Gives the parameters that followed others in an adjustment (`kByOthers`) their values.
void SetByOthers(BundleState* bundle);

/// Initial guess of one camera: parameters, and the target's pose in each of its views.
struct CameraGuess {
  std::vector<double> params;
  std::vector<std::optional<RigidTransform>> T_camera_target;  ///< per view
  double median_error = 0;  ///< median length of the residuals over the views tried, px
  std::string misfit;       ///< why the model does not describe the camera; may be empty
};

/// Initial guess of one camera: the model's candidates, each adjusted on a selection of the views
/// with a rigid target; the one with the smallest median residual wins. Throws `Error` of kind kJob
/// when no view shows enough of the target. The camera counts as the only one: its rules may refer
/// to camera 0 alone, which is itself. Residuals that the markers' tolerance explains start no
/// search for another minimum or lens.
CameraGuess GuessCamera(const CameraInput& camera,
                        const std::map<int, Eigen::Vector3d>& markers,
                        MarkerFreedom marker_freedom = {});

/// T_camera_target of one view from a part of its observations and a camera of known parameters;
/// nothing when they do not suffice.
std::optional<RigidTransform> GuessPose(const BundleCamera& camera,
                                        const View& view,
                                        const std::map<int, Eigen::Vector3d>& markers);

}  // namespace plenocal
