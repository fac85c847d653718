// SPDX-License-Identifier: Apache-2.0
//
// Detector of AprilTags.
#pragma once

#include <memory>
#include <vector>

#include "detectors/images/marker_detector.h"
#include "detectors/images/other_targets.h"
#include "detectors/templates/marker_template.h"
#include "targets/target.h"

namespace plenocal {

/// Finds tags with the AprilTag library and measures their corners. Throws `Error` for a family,
/// border or tag that does not exist. `others`: other targets of this family that may be in the
/// images, with tags of the same numbers; a tag that fits several targets is left out.
std::unique_ptr<MarkerDetector> MakeDetector(const TagLayout& layout,
                                             const Target& target,
                                             const OtherTargets& others);

namespace internal {

/// Of the tags with all four corners.
std::vector<MarkerTemplate> MakeTemplates(const TagLayout& layout,
                                          const Target& target,
                                          const std::vector<Observation>& found,
                                          const cv::Mat& gray);

}  // namespace internal

}  // namespace plenocal
