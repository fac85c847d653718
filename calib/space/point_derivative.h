// SPDX-License-Identifier: Apache-2.0
//
// Derivatives of one measurement by a point in space and by the calibration.
#pragma once

#include <Eigen/Core>

#include "calib/space/point_fit.h"
#include "calib/space/space_rig.h"

namespace plenocal {

struct PointDerivative {
  Eigen::VectorXd residual;  ///< measured - predicted, px
  Eigen::MatrixXd by_point;  ///< of the prediction, measured x 3, by the point's coordinates
  Eigen::VectorXd by_h;      ///< by its homogeneous coordinate
  Eigen::MatrixXd by_theta;  ///< measured x `SpaceRig::Size`
};

/// The image of the point p / h of the rig's frame. False outside the model's domain. `with_theta`:
/// else no `by_theta` is made.
bool Differentiate(const SpaceRig& rig,
                   const SpaceObservation& seen,
                   const Eigen::Vector3d& p,
                   double h,
                   PointDerivative* out,
                   bool with_theta = true);

}  // namespace plenocal
