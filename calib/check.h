// SPDX-License-Identifier: Apache-2.0
//
// Whether a calibration still holds for new images.
#pragma once

#include <string>
#include <vector>

#include "calib/calibrate.h"
#include "calib/calibration_file.h"

namespace plenocal {

/// One camera's parameters, or its place on the rig, against new images.
struct CameraCheck {
  std::string name;
  int points = 0;
  double rms_held = 0;  ///< with the old parameters, only poses free, px
  double rms_free = 0;  ///< with parameters of its own, px: the floor for this model
  double expected = 0;  ///< RMS with the old ones if they are right: with their errors, px
  /// Of a larger gap between both, if the old parameters are right within their covariance.
  double probability = 1;
  /// Likewise of the difference to the old place on the rig; 1 for the master.
  double mount_probability = 1;
  double mount_turn = 0, mount_shift = 0;  ///< of the place on the rig, rad and m
  bool valid = true;
};

struct CalibrationCheck {
  std::vector<CameraCheck> cameras;
  int frames = 0;
  bool valid = true;
  Calibration fresh;  ///< with all parameters free
};

/// `input`: the new observations of the old calibration's cameras, by name (a single one whatever
/// its name); models, start values and rules of the input are not used.
///
/// The new images are calibrated with all free, which gives noise and outliers, and once more with
/// one camera's parameters held at the old ones. By the extra-sum-of-squares test the gap between
/// both sums of squares, in units of the noise, is a weighted sum of chi-squares, one for each
/// parameter that the new images tell of, with weights 1 + mu, mu the eigenvalues of N C (N the
/// information of the new images, C the old covariance); taken for a multiple of F by its first two
/// moments (Satterthwaite 1946). Errors that the points of a frame have in common (target, motion)
/// make variances larger than the covariance says: by the factor that a jackknife over the new
/// frames finds, whose number gives F its second degrees of freedom. A camera is not valid when a
/// larger gap would show once in a hundred checks, all tests together. Throws `Error`.
CalibrationCheck CheckCalibration(const CalibrationFile& old,
                                  CalibrationInput input,
                                  const CalibrationOptions& options);

}  // namespace plenocal
