// SPDX-License-Identifier: Apache-2.0
//
// The detector of a target by its type.
#pragma once

#include <memory>

#include "detectors/images/marker_detector.h"
#include "detectors/images/other_targets.h"
#include "targets/target.h"

namespace plenocal {

/// The detector for the target's type. Throws `Error` for a type without one (`markers`). Defined
/// in marker_detectors.cc.in, which collects the detectors of all types. `others`: other targets of
/// the same type and tag family that may be in the images; numbered tags are of the target that
/// they fit.
std::unique_ptr<MarkerDetector> MakeMarkerDetector(const Target& target,
                                                   const OtherTargets& others = {});

}  // namespace plenocal
