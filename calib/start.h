// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/bundle.h"
#include "calib/camera_model.h"

namespace plenocal {

/// One camera of a calibration: its model and all its observations.
struct CameraInput {
  std::string name;
  const CameraModel* model = nullptr;
  std::vector<double> config;
  std::vector<std::optional<double>> initial;  ///< per parameter: the user's start value
  std::vector<bool> fixed;                     ///< per parameter: hold it at `initial`
  std::vector<ParamRule> rules = {};           ///< per parameter, or empty
  ImageSize image_size{};
  std::vector<View> views;
};

/// The camera in a bundle with these parameters: what its model holds is held, and the model's
/// priors are rules where the input has none.
BundleCamera MakeBundleCamera(const CameraInput& camera, std::vector<double> params);

/// A camera with start values of its own: parameters, and where it stood in each of its views.
struct CameraStart {
  std::vector<double> params;
  std::vector<std::optional<RigidTransform>> T_camera_target;  ///< per view
  double median_error = 0;  ///< median length of the residuals over the views tried
  std::string misfit;       ///< why the model does not describe the camera; may be empty
};

/// Start values of one camera: the model's candidates, each adjusted on a selection of the views
/// with the target held rigid; the one with the smallest median residual wins. Throws `Error` of
/// kind kJob when no view shows enough of the target. The camera counts as the only one: its rules
/// may refer to camera 0 alone, which is itself.
CameraStart StartCamera(const CameraInput& camera, const std::map<int, Eigen::Vector3d>& markers);

/// T_camera_target of one view from a part of its observations and a camera of known parameters;
/// nothing when they do not suffice.
std::optional<RigidTransform> StartPose(const CameraModel& model,
                                        std::span<const double> config,
                                        std::span<const double> params,
                                        const View& view,
                                        const std::map<int, Eigen::Vector3d>& markers);

/// T_camera_rig of every camera from the frames that cameras share, along a spanning tree with the
/// most common frames a link, so that chains of overlap suffice. `starts[i].T_camera_target`
/// belongs to `cameras[i].views`. Throws `Error` of kind kJob that names cameras without a link to
/// the master.
std::vector<RigidTransform> StartRig(std::span<const CameraInput> cameras,
                                     std::span<const CameraStart> starts);

}  // namespace plenocal
