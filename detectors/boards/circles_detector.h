// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "detectors/images/marker_detector.h"
#include "detectors/templates/marker_template.h"
#include "targets/target.h"

namespace plenocal {

std::unique_ptr<MarkerDetector> MakeDetector(const CirclesLayout& layout, const Target& target);

namespace internal {

/// Of the circles with enough neighbours for a homography. They are drawn as `DrawTarget` does;
/// their radius is not part of a target.
std::vector<MarkerTemplate> MakeTemplates(const CirclesLayout& layout,
                                          const Target& target,
                                          const std::vector<Observation>& found);

}  // namespace internal

}  // namespace plenocal
