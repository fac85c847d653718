// SPDX-License-Identifier: Apache-2.0
//
// The error of target types that have no detector.
#pragma once

#include <memory>
#include <string_view>
#include <vector>

#include "detectors/images/marker_detector.h"
#include "detectors/templates/marker_template.h"
#include "targets/target.h"

namespace plenocal {

/// Throws the `Error` of a target type that cannot be detected in images.
[[noreturn]] void FailWithoutDetector(std::string_view type);

/// Throws `Error`: points without a pattern cannot be detected in images.
std::unique_ptr<MarkerDetector> MakeDetector(const MarkersLayout& layout, const Target& target);

namespace internal {

/// Throws `Error`, as above.
std::vector<MarkerTemplate> MakeTemplates(const MarkersLayout& layout,
                                          const Target& target,
                                          const std::vector<Observation>& found);

}  // namespace internal

}  // namespace plenocal
