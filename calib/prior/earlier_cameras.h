// SPDX-License-Identifier: Apache-2.0
//
// Cameras of a session that builds on earlier calibrations: their start values, and the prior.
#pragma once

#include <optional>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/files/calibration_record.h"
#include "calib/files/scene_keys.h"
#include "calib/start/camera_guess.h"

namespace plenocal {

struct EarlierCameras {
  std::vector<CameraInput> inputs;  ///< `initial` and `fixed` with those of earlier calibrations
  /// Per camera: T_camera_rig of the earlier calibration; not set: not known. The first camera is
  /// the rig.
  std::vector<std::optional<RigidTransform>> T_camera_rig;
  std::vector<bool> fixed_extrinsics;     ///< per camera: known without standard error
  std::optional<CalibrationPrior> prior;  ///< on the unknowns chosen by `EarlierParams`
  /// Per camera: its earlier calibration states no standard errors, so that its parameters are
  /// fixed.
  std::vector<bool> without_sigmas;
};

/// An earlier calibration and the cameras of the session that take their values from it.
struct EarlierSource {
  const CalibrationRecord* record = nullptr;
  std::vector<size_t> cameras;  ///< indices into the session's cameras
  /// The cameras name it themselves: each must be in it, under its name or as the only one. Else
  /// those that it does not have start without it.
  bool is_named = false;
};

/// The treatment of a parameter that the earlier calibration leaves open (infinite standard error).
enum class OpenParams { kFixed, kFree };
/// The treatment of all other parameters: estimated, with the prior, or fixed at their earlier
/// values; then extrinsics have no prior either.
enum class EarlierIntrinsics { kPrior, kFixed };

struct EarlierOptions {
  OpenParams open = OpenParams::kFixed;
  EarlierIntrinsics intrinsics = EarlierIntrinsics::kPrior;
};

/// `inputs` as the session gives them, `keys` parallel. A parameter has the session's initial value
/// or the earlier one. One that the earlier calibration does not estimate stays fixed unless it is
/// in `EarlierParams::free`. The extrinsics of a source with several of the session's cameras are
/// used if the first camera is among these. Throws `Error` of kind kInput when a source has none of
/// its cameras, another model, size or constants of one, or, without `is_named`, several of them
/// but not the first.
EarlierCameras UseEarlierCalibrations(std::vector<CameraInput> inputs,
                                      const std::vector<EarlierParams>& keys,
                                      const std::vector<EarlierSource>& sources,
                                      const EarlierOptions& options);

}  // namespace plenocal
