// SPDX-License-Identifier: Apache-2.0
#include "targets/tags/quad.h"

#include <Eigen/LU>

namespace plenocal::internal {

Eigen::Matrix3d UnitSquareHomography(const Quad& q) {
  const Eigen::Vector2d sum = q[0] - q[1] + q[2] - q[3];
  Eigen::Matrix2d d;
  d << q[1] - q[2], q[3] - q[2];
  const Eigen::Vector2d g = d.inverse() * sum;
  Eigen::Matrix3d h;
  h << q[1] - q[0] + g[0] * q[1], q[3] - q[0] + g[1] * q[3], q[0], g[0], g[1], 1;
  return h;
}

}  // namespace plenocal::internal
