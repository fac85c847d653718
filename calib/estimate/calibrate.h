// SPDX-License-Identifier: Apache-2.0
//
// From observations to a calibration: initial guess, the shared bundle adjustment with rejection of
// outliers and estimation of the noise, uncertainty.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/base/error.h"
#include "calib/estimate/fit.h"
#include "calib/files/finding.h"
#include "calib/noise/jackknife.h"
#include "calib/noise/uncertainty.h"
#include "calib/start/input.h"

namespace plenocal {

struct CalibrationOptions {
  int threads = 0;  ///< 0: all cores
  /// Called with the present stage; false stops the calibration (`Stopped` is thrown).
  std::function<bool(const std::string& stage)> progress;
};

struct Calibration {
  std::vector<std::string> frames;  ///< names, sorted; index as in Bundle::T_rig_target
  Bundle bundle;
  std::vector<CameraFit> fits;  ///< per camera of the bundle
  Uncertainty uncertainty;
  /// Set by the caller (`EstimateByJackknife`).
  std::optional<Jackknife> jackknife;
  bool converged = false;
  int iterations = 0;
  /// Outliers have weighted residuals longer than this many sigmas.
  double rejection_threshold = 0;
  std::vector<LeftOut> left_out;
  std::vector<Finding> findings;  ///< of the estimation itself
};

/// The start of a calibration with further frames.
CalibrationStart StartFrom(const Calibration& calibration);

/// Throws `Error` of kind kJob when the observations do not suffice.
///
/// Outliers: after a robust solve, an observation is rejected when a residual as long as its own is
/// expected less than once in twenty calibrations of this size from Gaussian noise (chi-square
/// quantile at 1 - 0.05 / N); this repeats until nothing changes.
Calibration Calibrate(const CalibrationInput& input, const CalibrationOptions& options);

}  // namespace plenocal
