// SPDX-License-Identifier: Apache-2.0
//
// Test of an existing calibration against new images.
#pragma once

#include <string>
#include <vector>

#include "calib/estimate/calibrate.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// The parameters and the extrinsics of one camera against new images.
struct CameraCheck {
  std::string name;
  int points = 0;
  double rms_held = 0;  ///< with the old parameters fixed and only poses estimated, px
  double rms_free = 0;  ///< with parameters estimated from the new images, px
  double expected = 0;  ///< of rms_held if the old parameters are right within their covariance, px
  /// p-value of the difference between both under that hypothesis.
  double probability = 1;
  /// p-value of the change of the extrinsics; 1 for the master.
  double extrinsics_probability = 1;
  double rotation = 0, translation = 0;  ///< change of the extrinsics, rad and m
  bool valid = true;
};

struct CalibrationCheck {
  std::vector<CameraCheck> cameras;
  int frames = 0;
  double level =
      0;  ///< of each test: all together show a false difference once in a hundred checks
  bool valid = true;
  Calibration fresh;  ///< with all parameters free
};

/// `input`: the new observations of the old calibration's cameras, by name (a single one whatever
/// its name); models, initial guesses and rules of the input are not used.
///
/// The new images are calibrated with all free, which gives noise and outliers, and once more with
/// the parameters of one camera fixed at the old ones. By the extra-sum-of-squares test the
/// difference of both sums of squares, in units of the noise, is a weighted sum of chi-squares, one
/// for each parameter that the new images determine, with weights 1 + mu, mu the eigenvalues of N C
/// (N the information of the new images, C the old covariance). It is approximated by a multiple of
/// F with the same first two moments (Satterthwaite 1946). Per-frame systematic errors (target,
/// motion) make variances larger than the covariance: by a factor that a jackknife over the new
/// frames estimates; the number of its groups gives F its second degrees of freedom. A camera is
/// not valid when all tests together would show so large a difference once in a hundred checks.
/// Throws `Error`.
CalibrationCheck CheckCalibration(const CalibrationRecord& old,
                                  CalibrationInput input,
                                  const CalibrationOptions& options);

/// The outcome as findings: for each camera `parameters_changed`, for each but the master
/// `mount_changed`, bad where the test fails, else good.
Verdict JudgeCheck(const CalibrationCheck& check);

}  // namespace plenocal
