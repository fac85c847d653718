// SPDX-License-Identifier: Apache-2.0
//
// Example of a target type (docs/architecture.md): in detectors/boards/.
#pragma once

#include <memory>
#include <vector>

#include "detectors/images/marker_detector.h"
#include "detectors/templates/marker_template.h"
#include "targets/target.h"

namespace plenocal {

/// Throws `Error`: this example has no detector, its observations come from files.
std::unique_ptr<MarkerDetector> MakeDetector(const HexagonalLayout& layout, const Target& target);

namespace internal {

/// Of the circles with enough neighbours for a homography.
std::vector<MarkerTemplate> MakeTemplates(const HexagonalLayout& layout,
                                          const Target& target,
                                          const std::vector<Observation>& found);

}  // namespace internal

}  // namespace plenocal
