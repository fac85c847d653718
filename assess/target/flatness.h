// SPDX-License-Identifier: Apache-2.0
//
// Whether a target that was held flat is flat, and what it does to the cameras if not.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "calib/estimate/calibrate.h"
#include "calib/files/finding.h"

namespace plenocal {

struct BentTarget {
  Finding finding;
  std::vector<double> residual;  ///< per camera: noise of a coordinate with free markers, px
};

/// A second calibration with free markers, compared with the first: an F-test of its residuals (one
/// false alarm in a million), and the projection of each camera's model by both. The grade follows
/// from the RMS difference over the image at the target's distance, where that is beyond three
/// standard errors; a target that causes more than half of the residuals' variance is named
/// whatever it does to the cameras. Nothing for calibrations that have estimated the markers and
/// for targets that lie in no plane. `go_on` as in `SolveOptions`.
std::optional<BentTarget> FindBentTarget(const Calibration& calibration,
                                         Loss loss,
                                         const std::function<bool()>& go_on);

}  // namespace plenocal
