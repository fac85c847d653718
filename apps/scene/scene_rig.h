// SPDX-License-Identifier: Apache-2.0
//
// Cameras of a calibration without a target before it: their start values, and the prior of an
// earlier calibration.
#pragma once

#include <optional>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/files/calibration_record.h"
#include "calib/files/scene_keys.h"
#include "calib/start.h"

namespace plenocal {

struct SceneCameras {
  std::vector<CameraInput> inputs;  ///< `initial` and `fixed` with those of the earlier calibration
  /// Per camera: T_camera_rig of the earlier calibration; not set: not known. The first camera is
  /// the rig.
  std::vector<std::optional<RigidTransform>> T_camera_rig;
  std::vector<bool> holds_extrinsics;     ///< per camera: they are known without standard error
  std::optional<CalibrationPrior> prior;  ///< on the unknowns chosen by `EarlierParams`
};

/// `inputs` as the session gives them, `keys` parallel. A parameter has the session's initial value
/// or the earlier one. One that the earlier calibration does not estimate stays fixed unless it is
/// in `EarlierParams::free`. Throws `Error` of kind kInput when the earlier calibration has none of
/// the cameras, another model of one, or several of them but not the first.
SceneCameras MakeSceneCameras(std::vector<CameraInput> inputs,
                              const std::vector<EarlierParams>& keys,
                              const CalibrationRecord* earlier);

}  // namespace plenocal
