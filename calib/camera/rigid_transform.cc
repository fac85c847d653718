// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/rigid_transform.h"

#include <cmath>

namespace plenocal {
namespace {

// Coefficients of the series in theta^2 below which sin and cos lose digits by cancellation.
constexpr double kSmallAngleSquared = 1e-6;

struct RotationCoefficients {
  double a;  // sin(theta) / theta
  double b;  // (1 - cos(theta)) / theta^2
  double c;  // (theta - sin(theta)) / theta^3
};

RotationCoefficients Coefficients(const Eigen::Vector3d& w) {
  const double theta2 = w.squaredNorm();
  if (theta2 < kSmallAngleSquared) {
    return {1 - theta2 / 6 + theta2 * theta2 / 120,
            0.5 - theta2 / 24 + theta2 * theta2 / 720,
            1.0 / 6 - theta2 / 120 + theta2 * theta2 / 5040};
  }
  const double theta = std::sqrt(theta2);
  const double half_sin = std::sin(theta / 2);
  return {std::sin(theta) / theta,
          2 * half_sin * half_sin / theta2,
          (theta - std::sin(theta)) / (theta2 * theta)};
}

}  // namespace

Eigen::Matrix3d Hat(const Eigen::Vector3d& a) {
  Eigen::Matrix3d A;
  A << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return A;
}

Eigen::Matrix3d ExpRotation(const Eigen::Vector3d& w) {
  const auto [a, b, c] = Coefficients(w);
  const Eigen::Matrix3d W = Hat(w);
  return Eigen::Matrix3d::Identity() + a * W + b * W * W;
}

Eigen::Vector3d LogRotation(const Eigen::Matrix3d& R) {
  const Eigen::AngleAxisd angle_axis{Eigen::Quaterniond(R)};
  return angle_axis.angle() * angle_axis.axis();
}

Eigen::Matrix3d LeftJacobian(const Eigen::Vector3d& w) {
  const auto [a, b, c] = Coefficients(w);
  const Eigen::Matrix3d W = Hat(w);
  return Eigen::Matrix3d::Identity() + b * W + c * W * W;
}

RigidTransform Exp(const Vector6d& xi) {
  return {ExpRotation(xi.tail<3>()), LeftJacobian(xi.tail<3>()) * xi.head<3>()};
}

Vector6d Log(const RigidTransform& T) {
  Vector6d xi;
  xi.tail<3>() = LogRotation(T.R);
  xi.head<3>() = LeftJacobian(xi.tail<3>()).inverse() * T.t;
  return xi;
}

RigidTransform Retract(const RigidTransform& T, const Vector6d& delta) {
  return {ExpRotation(delta.tail<3>()) * T.R, T.t + delta.head<3>()};
}

Vector6d LocalCoordinates(const RigidTransform& origin, const RigidTransform& T) {
  Vector6d delta;
  delta << T.t - origin.t, LogRotation(T.R * origin.R.transpose());
  return delta;
}

Matrix6d LogJacobian(const RigidTransform& T) {
  // Central differences: the step balances rounding (eps / h) against the third derivative (h^2).
  constexpr double kStep = 1e-5;
  Matrix6d J;
  for (int i = 0; i < 6; ++i) {
    const Vector6d step = kStep * Vector6d::Unit(i);
    J.col(i) = (Log(Retract(T, step)) - Log(Retract(T, -step))) / (2 * kStep);
  }
  return J;
}

Matrix6d InverseLogJacobian(const RigidTransform& T) {
  // T^-1 = (R', -R' t): R' Exp(-w) = Exp(-R' w) R'; its t changes by -R' v - R' Hat(t) w.
  Matrix6d J = Matrix6d::Zero();
  const Eigen::Matrix3d Rt = T.R.transpose();
  J.topLeftCorner<3, 3>() = -Rt;
  J.topRightCorner<3, 3>() = -Rt * Hat(T.t);
  J.bottomRightCorner<3, 3>() = -Rt;
  return LogJacobian(T.Inverse()) * J;
}

}  // namespace plenocal
