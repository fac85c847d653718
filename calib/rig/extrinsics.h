// SPDX-License-Identifier: Apache-2.0
//
// The pose of a camera in its rig in the units in which people measure one.
#pragma once

#include <string_view>
#include <vector>

#include "calib/files/calibration_record.h"

namespace plenocal {

/// A number that a pose consists of, or that follows from it.
struct Extrinsic {
  std::string_view name, unit;
  double value = 0;
  double sigma = 0;  ///< standard error; 0: fixed, infinite: not determined
};

/// Distance from the rig's master and angle between both cameras' frames, then the camera's optical
/// centre and rotation vector in the master's frame; mm and degrees. Empty for the master itself.
/// `covariance`: of the se(3) vector of T_camera_rig; infinite where it is not determined.
std::vector<Extrinsic> ExtrinsicsOf(const RigidTransform& T_camera_rig, const Matrix6d& covariance);
std::vector<Extrinsic> ExtrinsicsOf(const CalibratedCamera& camera,
                                    const Correlations& correlations);

}  // namespace plenocal
