// SPDX-License-Identifier: Apache-2.0
//
// Views suggested for a calibration, and its points as the input of another one.
#pragma once

#include <optional>
#include <vector>

#include "assess/views/next_views.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

struct SuggestedViews {
  RigEstimate rig;  ///< what the views are chosen for
  ViewTarget shape;
  std::optional<Verdict> verdict;  ///< of the calibration so far
  NextViews views = {};
};

/// The points of a calibration's camera, as its images had them.
std::vector<View> ViewsOf(const CalibrationRecord& calibration, const CalibratedCamera& camera);

}  // namespace plenocal
