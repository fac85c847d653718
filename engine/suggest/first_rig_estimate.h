// SPDX-License-Identifier: Apache-2.0
//
// The estimate of a rig before its images allow a calibration.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "assess/views/rig_estimate.h"
#include "calib/start/camera_guess.h"

namespace plenocal {

/// A camera of which only the data sheet is known.
struct FirstCamera {
  std::string name;
  const CameraModel* model = nullptr;
  ImageSize image_size{};
  double angle = 0;              ///< horizontal field of view, rad
  std::vector<View> views = {};  ///< images so far, if there are any
};

/// Parameters as the model has them for a lens without distortion: a pinhole camera up to 100
/// degrees, r = f phi beyond. Extrinsics are unknown, all cameras stand where the first does.
/// Throws `Error` of kind kInput for plenoptic models, which need white images, and where the model
/// cannot have this angle.
RigEstimate MakeFirstRigEstimate(const std::vector<FirstCamera>& cameras,
                                 const std::map<int, Eigen::Vector3d>& markers,
                                 MarkerFreedom marker_freedom);

}  // namespace plenocal
