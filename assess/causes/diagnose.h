// SPDX-License-Identifier: Apache-2.0
//
// Causes by name: mistakes of target file, lens model and recording that users really make
// (docs/diagnosis.md). The single causes stand in the table of cause.h.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "calib/camera/target_hypothesis.h"
#include "calib/estimate/calibrate.h"
#include "calib/files/calibration_record.h"
#include "calib/traits/image_traits.h"

namespace plenocal {

/// Causes in the target and its file, worst first. `calibration`: of `input`, null where it has
/// failed; without it the layout alone can be tested. Whether a board is bent is for `Diagnose`: a
/// wrong lens model looks like it.
std::vector<Finding> FindTargetCauses(const CalibrationInput& input,
                                      const TargetDoubts& doubts,
                                      const Calibration* calibration);

/// Judges a calibration: adds the causes that its residuals and poses show to `record->findings`
/// and sets `record->verdict`. `record` is the result of `Describe(calibration)`. `traits`: of the
/// images, by camera; empty where they are not at hand. Where residuals are larger than noise,
/// `models` are tried in place of the camera's own, and free markers in place of a flat target:
/// what explains the residuals best is named. `go_on` as in `SolveOptions`.
void Diagnose(const CalibrationInput& input,
              const Calibration& calibration,
              std::span<const CameraTraits> traits,
              std::span<const CameraModel> models,
              const std::function<bool()>& go_on,
              CalibrationRecord* record);

}  // namespace plenocal
