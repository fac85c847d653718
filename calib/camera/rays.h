// SPDX-License-Identifier: Apache-2.0
//
// Projection and rays of cameras that have `model`, `params` and `config`: calibrated ones, those
// of a bundle.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "calib/camera/camera_model.h"

namespace plenocal {

/// As `CameraModel::Project` with the camera's parameters.
template <typename Camera>
bool Project(const Camera& camera,
             const double* values,
             const Eigen::Vector3d& p_cam,
             double* predicted) {
  return camera.model->Project(
      camera.params.data(), camera.config.data(), values, p_cam, predicted);
}

/// As `CameraModel::Unproject` with the camera's parameters.
template <typename Camera>
std::optional<Ray> Unproject(const Camera& camera, const double* values) {
  return camera.model->Unproject(camera.params.data(), camera.config.data(), values);
}

}  // namespace plenocal
