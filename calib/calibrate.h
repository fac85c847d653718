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
#include "calib/base/robust.h"
#include "calib/files/finding.h"
#include "calib/fit.h"
#include "calib/noise/jackknife.h"
#include "calib/noise/uncertainty.h"
#include "calib/start.h"

namespace plenocal {

/// Of several targets, number `k` has the markers from k times this on.
inline constexpr int kMarkersPerTarget = 100000;
inline size_t TargetOfMarker(int number) { return static_cast<size_t>(number / kMarkersPerTarget); }

/// One of several targets.
struct InputTarget {
  std::string name;
  bool moves = false;                   ///< with respect to all others
  std::optional<RigidTransform> known;  ///< its frame to that of the first target
};

struct CalibrationInput {
  std::vector<CameraInput> cameras;  ///< the first is the rig's master
  /// By number, m. Of several targets, each in its target's own frame.
  std::map<int, Eigen::Vector3d> markers;
  std::vector<InputTarget> targets = {};  ///< empty: one target
  double marker_sigma = 0;  ///< prior of each marker coordinate, m; 0: markers are not estimated
  Loss loss = Loss::kHuber;
  /// Of earlier calibrations: the prior of parameters and extrinsics, and T_camera_rig of each
  /// camera (per camera, or empty).
  std::optional<CalibrationPrior> prior = {};
  std::vector<std::optional<RigidTransform>> earlier_T_camera_rig = {};
};

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

/// Throws `Error` of kind kJob when the observations do not suffice.
///
/// Outliers: after a robust solve, an observation is rejected when a residual as long as its own is
/// expected less than once in twenty calibrations of this size from Gaussian noise (chi-square
/// quantile at 1 - 0.05 / N); this repeats until nothing changes.
Calibration Calibrate(const CalibrationInput& input, const CalibrationOptions& options);

}  // namespace plenocal
