// SPDX-License-Identifier: Apache-2.0
//
// Derivatives of a camera's projection by its parameters and by the point.
#pragma once

#include <Eigen/Core>

#include "calib/camera/camera_model.h"

namespace plenocal {

struct ProjectionJacobian {
  Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxObservationSize, 1> predicted;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> by_params;
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor, kMaxObservationSize, 3> by_point;
};

/// False outside the domain of the model, and where a result is not finite. `Camera` has model,
/// params and config; `values`: measured coordinates (not used) and context.
template <typename Camera>
[[nodiscard]] bool Differentiate(const Camera& camera,
                                 const double* values,
                                 const Eigen::Vector3d& p_cam,
                                 ProjectionJacobian* out) {
  const auto rows = static_cast<Eigen::Index>(camera.model->measured.size());
  out->predicted.resize(rows);
  out->by_params.resize(rows, static_cast<Eigen::Index>(camera.model->params.size()));
  out->by_point.resize(rows, 3);
  return camera.model->ProjectWithJacobian(
             camera.params.data(),
             camera.config.data(),
             values,
             p_cam,
             {out->predicted.data(), out->by_params.data(), out->by_point.data()}) &&
         out->predicted.allFinite() && out->by_params.allFinite() && out->by_point.allFinite();
}

}  // namespace plenocal
