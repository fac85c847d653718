// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "calib/files/calibration_record.h"
#include "models/registry.h"

namespace plenocal::testing {

/// The camera "left" of 640 x 480 pixels.
inline CalibratedCamera CameraOf(const std::string& model, const std::vector<double>& params) {
  CalibratedCamera camera;
  camera.name = "left";
  camera.model = FindModel(CameraModels(), model);
  camera.params = params;
  camera.image_size = {640, 480};
  return camera;
}

}  // namespace plenocal::testing
