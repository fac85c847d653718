// SPDX-License-Identifier: Apache-2.0
//
// A calibration as plain data for files, report and comparisons.
#pragma once

#include "calib/estimate/calibrate.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// All results. `path` and `provenance` are the caller's, and so are the names of the cameras'
/// files; `markers` are those that took part.
CalibrationRecord Describe(const Calibration& calibration);

/// One camera of it, without view poses and residuals.
CalibratedCamera DescribeCamera(const Calibration& calibration, size_t camera);

/// Correlations of all free parameters and of the se(3) vectors of the cameras in the rig.
Correlations DescribeCorrelations(const Calibration& calibration);

}  // namespace plenocal
