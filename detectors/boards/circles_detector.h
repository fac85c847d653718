// SPDX-License-Identifier: Apache-2.0
//
// Detector of circle grids.
#pragma once

#include <memory>
#include <vector>

#include "detectors/images/marker_detector.h"
#include "detectors/images/other_targets.h"
#include "detectors/templates/marker_template.h"
#include "targets/target.h"

namespace plenocal {

/// `others`: other grids that may be in the images. A part of a larger one of them is no board; nor
/// is a board at the image's border, beyond which it may go on.
std::unique_ptr<MarkerDetector> MakeDetector(const CirclesLayout& layout,
                                             const Target& target,
                                             const OtherTargets& others);

namespace internal {

/// Of the circles with enough neighbours for a homography. They are drawn as `DrawTarget` does;
/// their radius is not part of a target.
std::vector<MarkerTemplate> MakeTemplates(const CirclesLayout& layout,
                                          const Target& target,
                                          const std::vector<Observation>& found);

}  // namespace internal

}  // namespace plenocal
