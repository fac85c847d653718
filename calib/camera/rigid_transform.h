// SPDX-License-Identifier: Apache-2.0
//
// Rotations and rigid transforms, their logarithms and the chart in which poses are estimated.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace plenocal {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Matrix of the cross product: Hat(a) * b = a x b.
Eigen::Matrix3d Hat(const Eigen::Vector3d& a);
/// Rotation by |w| about w (Rodrigues).
Eigen::Matrix3d ExpRotation(const Eigen::Vector3d& w);
/// Inverse of ExpRotation with |w| <= pi.
Eigen::Vector3d LogRotation(const Eigen::Matrix3d& R);
/// Left Jacobian of SO(3): Exp(w + dw) = Exp(J dw) Exp(w) to first order.
Eigen::Matrix3d LeftJacobian(const Eigen::Vector3d& w);

/// Rigid motion T_a_b: p_a = R * p_b + t.
struct RigidTransform {
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d t = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& p) const { return R * p + t; }
  RigidTransform operator*(const RigidTransform& b) const { return {R * b.R, R * b.t + t}; }
  [[nodiscard]] RigidTransform Inverse() const { return {R.transpose(), -(R.transpose() * t)}; }
};

/// exp(xi^) of se(3), xi = [v, w] with the translational part first (docs/conventions.md).
RigidTransform Exp(const Vector6d& xi);
/// Inverse of Exp.
Vector6d Log(const RigidTransform& T);

/// The chart in which poses are estimated: R' = Exp(w) R, t' = t + v for delta = [v, w].
/// Cheaper than Exp of se(3) and, unlike one global chart, never near a singularity.
RigidTransform Retract(const RigidTransform& T, const Vector6d& delta);
/// Inverse of Retract: delta with Retract(origin, delta) = T.
Vector6d LocalCoordinates(const RigidTransform& origin, const RigidTransform& T);
/// Derivative of Log(Retract(T, delta)) at delta = 0: carries the covariance of a pose from its
/// chart to the se(3) vector that files hold.
Matrix6d LogJacobian(const RigidTransform& T);
/// Derivative of Log(Retract(T, delta).Inverse()) at delta = 0: to the se(3) vector of the inverse.
Matrix6d InverseLogJacobian(const RigidTransform& T);

}  // namespace plenocal
