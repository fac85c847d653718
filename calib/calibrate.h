// SPDX-License-Identifier: Apache-2.0
//
// From observations to a calibration: start values, the shared bundle adjustment, rejection of
// outliers, noise and uncertainty.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/bundle.h"
#include "calib/error.h"
#include "calib/jackknife.h"
#include "calib/own_noise.h"
#include "calib/start.h"
#include "calib/uncertainty.h"

namespace plenocal {

struct CalibrationInput {
  std::vector<CameraInput> cameras;  ///< the first is the rig's master
  std::map<int, Eigen::Vector3d> markers;
  double marker_sigma = 0;  ///< prior of each marker coordinate, m; 0 holds the markers
  Loss loss = Loss::kHuber;
};

struct CalibrationOptions {
  int threads = 0;  ///< 0: all cores
  /// Called with what is being done now; false stops the calibration (`Stopped` is thrown).
  std::function<bool(const std::string& stage)> progress;
};

/// How well one camera is explained.
struct CameraFit {
  int points = 0;    ///< used observations
  int rejected = 0;  ///< observations that were left out as outliers or outside the model's domain
  int views = 0;     ///< views with used observations
  double rms = 0;    ///< over used observations, of the residual vector's length
  double sigma = 0;  ///< noise of one coordinate of a typical observation, from the residuals
  /// The typical sigma that came with the observations; 0 when none came. Noise above it is error
  /// that the detector does not know of.
  double stated_sigma = 0;
  /// The same over the observations of one kind.
  struct Kind {
    int points = 0;
    double rms = 0;
  };
  std::map<int, Kind> kinds;  ///< by `Observation::kind`; empty when all are alike
  /// What the observations themselves allow (`FloorOf`), of the used ones and of all that project;
  /// and the RMS of the latter.
  std::optional<Floor> floor, floor_all;
  double rms_all = 0;
};

struct Calibration {
  std::vector<std::string> camera_names;
  std::vector<ImageSize> image_sizes;
  /// Per camera: key and name of files beside calibration.yaml that belong to it; may be empty.
  std::vector<std::vector<std::pair<std::string, std::string>>> camera_files;
  std::vector<std::string> frames;  ///< names, sorted; index as in Bundle::T_rig_target
  Bundle bundle;
  std::vector<CameraFit> fits;
  Uncertainty uncertainty;
  /// Set by the caller who wants it (`EstimateByJackknife`).
  std::optional<Jackknife> jackknife;
  bool converged = false;
  int iterations = 0;
  /// Outliers have weighted residuals longer than this many sigmas.
  double rejection_threshold = 0;
  std::vector<LeftOut> left_out;
  /// Findings that the user should read, in words.
  std::vector<std::string> warnings;
};

/// Throws `Error` of kind kJob when the observations do not suffice.
///
/// Outliers: after a robust solve, an observation is rejected when a residual as long as its own is
/// expected less than once in twenty calibrations of this size from Gaussian noise (chi-square
/// quantile at 1 - 0.05 / N); this repeats until nothing changes.
Calibration Calibrate(const CalibrationInput& input, const CalibrationOptions& options);

}  // namespace plenocal
