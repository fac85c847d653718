// SPDX-License-Identifier: Apache-2.0
//
// Grade of a calibration for its use: first the uncertainty of the projection over the image, then
// what makes the stated uncertainty doubtful (noise, patterns in the residuals, image parts without
// points), and the causes that are known.
#pragma once

#include <string>

#include "calib/files/calibration_record.h"
#include "calib/files/finding.h"

namespace plenocal {

/// The grade of a calibration with its findings: those in `calibration.findings`, which the
/// estimation and the tests for causes have made, and those of this function. A cause has the grade
/// of the worst consequence that it explains. The same finding of several cameras is one.
Verdict Judge(const CalibrationRecord& calibration);

/// Whether a camera's residuals are larger than its detector's noise, or have a pattern over the
/// image, by more than a tenth of a pixel: something does not describe the images.
bool HasUnexplainedResiduals(const CalibratedCamera& camera);

/// The grade as a sentence.
std::string Headline(const Verdict& verdict);

/// Grade, code, what and remedy of a finding; of a good one without the first two.
std::string FindingText(const Finding& finding);

/// For a terminal: a paragraph for each finding that a user should read, worst last, then the
/// grade. Ends in a newline.
std::string VerdictText(const Verdict& verdict);

}  // namespace plenocal
