// SPDX-License-Identifier: Apache-2.0
//
// Detector of ChArUco boards.
#pragma once

#include <memory>
#include <vector>

#include "detectors/images/marker_detector.h"
#include "detectors/images/other_targets.h"
#include "detectors/templates/marker_template.h"
#include "targets/target.h"

namespace plenocal {

/// Throws `Error` for a dictionary that OpenCV does not have or that has too few markers. `others`:
/// other boards with markers of this dictionary that may be in the images; a marker that fits
/// several boards is left out.
std::unique_ptr<MarkerDetector> MakeDetector(const CharucoLayout& layout,
                                             const Target& target,
                                             const OtherTargets& others);

namespace internal {

/// Of the corners with enough neighbours for a homography.
std::vector<MarkerTemplate> MakeTemplates(const CharucoLayout& layout,
                                          const Target& target,
                                          const std::vector<Observation>& found);

}  // namespace internal

}  // namespace plenocal
