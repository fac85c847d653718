// SPDX-License-Identifier: Apache-2.0
//
// Findings of the estimation itself (docs/diagnosis.md).
#pragma once

#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/files/finding.h"
#include "calib/noise/uncertainty.h"

namespace plenocal {

/// The camera's frames scatter `ratio` times more than detection noise explains.
Finding FindingOfSystematicErrors(const std::string& camera, double ratio);

/// All frames show the target from one pose.
Finding FindingOfOnePose(size_t frames);

/// The camera's model does not describe its initial guess: `misfit` is why.
Finding FindingOfMisfit(const std::string& camera, const std::string& misfit);

/// The rig is not rigid or not synchronous; empty when it is both.
std::vector<Finding> FindingsOfJitter(const Bundle& bundle);
/// Cameras whose images were taken at another time than they state.
std::vector<Finding> FindingsOfTimeShifts(const Bundle& bundle, const Uncertainty& uncertainty);

/// Sizes of targets that images and measured distances contradict, and distances that contradict a
/// size which is taken as known.
std::vector<Finding> FindingsOfTargetScale(const Bundle& bundle, const Uncertainty& uncertainty);

/// Bounds that the estimate lies on, and priors that the images contradict.
std::vector<Finding> FindingsOfRules(const Bundle& bundle, const Uncertainty& uncertainty);

}  // namespace plenocal
