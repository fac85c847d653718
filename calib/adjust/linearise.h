// SPDX-License-Identifier: Apache-2.0
//
// Residuals and their derivatives, shared by the solver's cost function and by the covariance, so
// that both use the same linearisation.
#pragma once

#include <Eigen/Core>

#include "calib/adjust/bundle.h"

namespace plenocal::internal {

/// Poses that one view's observations share, with the Jacobian of each chart at its present value.
struct LinearisedView {
  RigidTransform T_camera_rig, T_rig_target;
  Eigen::Matrix3d chart_extrinsics = Eigen::Matrix3d::Identity();  ///< left Jacobian at the
                                                                   ///< chart's w
  Eigen::Matrix3d chart_pose = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d chart_jitter = Eigen::Matrix3d::Identity();
  /// Change of T_rig_target with the camera's time shift: of t, and the left rotation, 1/s.
  Vector6d by_time_shift = Vector6d::Zero();
};

/// The poses of a view of `bundle` as they are, the charts at their origins.
LinearisedView ViewOf(const Bundle& bundle, size_t frame, size_t camera);

/// Rotation, left of the pose that a camera saw, by the rotation of the frame's pose in the chart
/// about its present value and by that of the view's jitter.
struct ViewCharts {
  Eigen::Matrix3d pose = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d jitter = Eigen::Matrix3d::Identity();
};
ViewCharts ChartsOf(const Bundle& bundle, size_t frame, size_t camera);

/// Memory for one observation's weighted residual and derivatives; row-major, one row a
/// measured coordinate. Null pointers are not written.
struct LinearisedRows {
  double* residual = nullptr;
  double* J_params = nullptr;      ///< rows x params
  double* J_extrinsics = nullptr;  ///< rows x 6, chart of T_camera_rig
  double* J_pose = nullptr;        ///< rows x 6, chart of T_rig_target
  double* J_jitter = nullptr;      ///< rows x 6, chart of Jitter::delta
  double* J_marker = nullptr;      ///< rows x 3

  [[nodiscard]] bool HasDerivatives() const {
    return J_params != nullptr || J_extrinsics != nullptr || J_pose != nullptr ||
           J_jitter != nullptr || J_marker != nullptr;
  }
};

/// Residual of one observation in standard deviations of its own noise with its derivatives; false
/// outside the model's domain. Common noise is applied to sums of rows (`CommonShare`). Without
/// J_params the others cost a third.
bool Linearise(const BundleCamera& camera,
               const double* params,
               const LinearisedView& view,
               const Eigen::Vector3d& p_target,
               const BundleObservation& observation,
               const LinearisedRows& out);

/// Derivative of a point at `p_target`, in the frame of the first target, by the chart of the pose
/// of the target on which it is.
inline Eigen::Matrix<double, 3, 6> PointByTargetPose(const RigidTransform& T_target_own,
                                                     const Eigen::Vector3d& p_target) {
  Eigen::Matrix<double, 3, 6> J;
  J << Eigen::Matrix3d::Identity(), -Hat(p_target - T_target_own.t);
  return J;
}

/// With rows y_i of one marker in one view in their own sigmas sigma_i, common noise t takes
/// CommonShare(t, sum 1 / sigma_i^2) times the square of sum y_i / sigma_i from the sum of y_i^2
/// (the inverse of diag(sigma_i^2) + t^2 1 1', by Sherman and Morrison).
inline double CommonShare(double common_sigma, double information) {
  const double variance = common_sigma * common_sigma;
  return variance / (1 + variance * information);
}

}  // namespace plenocal::internal
