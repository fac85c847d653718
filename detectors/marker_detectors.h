// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "detectors/images/marker_detector.h"
#include "targets/target.h"

namespace plenocal {

/// The detector for the target's type. Throws `Error` for a type without one (`markers`). Defined
/// in marker_detectors.cc.in, which collects the detectors of all types.
std::unique_ptr<MarkerDetector> MakeMarkerDetector(const Target& target);

}  // namespace plenocal
