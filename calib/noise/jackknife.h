// SPDX-License-Identifier: Apache-2.0
//
// Standard errors by leaving out frames: a check of those from the covariance that does not rely on
// independent errors of known size.
#pragma once

#include <functional>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/base/robust.h"

namespace plenocal {

struct JackknifeOptions {
  int groups = 20;  ///< at most; as many as there are frames when these are fewer
  Loss loss = Loss::kHuber;
  double cost_tolerance = 1e-9;
  int threads = 0;  ///< 0: all cores
  /// Called after each group with the number done; false stops (`Stopped` is thrown).
  std::function<bool(size_t done, size_t all)> progress;
};

/// Delete-a-group jackknife: sigma^2 = (G - 1) / G sum (x_g - mean)^2 over calibrations that each
/// leave out one of G groups of successive frames. It does not contain errors that all frames
/// share, as those of the target's nominal shape.
struct Jackknife {
  int groups = 0;
  /// Per camera: standard error of each parameter; infinite for a camera that fewer than two groups
  /// see.
  std::vector<std::vector<double>> param_std_errors;
  /// Per camera: standard errors of the se(3) vector of T_camera_rig.
  std::vector<Vector6d> extrinsics_std_errors;
};

/// `bundle` is the calibration with all frames: each solve starts there, with its outliers and
/// noise. Throws `Error` of kind kJob for fewer than two frames with observations.
Jackknife EstimateByJackknife(const Bundle& bundle, const JackknifeOptions& options);

}  // namespace plenocal
