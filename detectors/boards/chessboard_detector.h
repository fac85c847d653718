// SPDX-License-Identifier: Apache-2.0
//
// Detector of chessboards.
#pragma once

#include <memory>
#include <vector>

#include "detectors/images/marker_detector.h"
#include "detectors/images/other_targets.h"
#include "detectors/templates/marker_template.h"
#include "targets/target.h"

namespace plenocal {

/// `others`: other chessboards that may be in the images. A part of a larger one of them is no
/// board; nor is a board at the image's border, beyond which it may go on.
std::unique_ptr<MarkerDetector> MakeDetector(const ChessboardLayout& layout,
                                             const Target& target,
                                             const OtherTargets& others);

namespace internal {

/// Of the corners with enough neighbours for a homography.
std::vector<MarkerTemplate> MakeTemplates(const ChessboardLayout& layout,
                                          const Target& target,
                                          const std::vector<Observation>& found);

}  // namespace internal

}  // namespace plenocal
