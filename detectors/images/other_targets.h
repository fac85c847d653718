// SPDX-License-Identifier: Apache-2.0
//
// Targets beside a detector's own that may be in its images.
#pragma once

#include <cstddef>
#include <vector>

#include "targets/target.h"

namespace plenocal {

/// Other targets of a detector's type and family that may be in its images.
struct OtherTargets {
  std::vector<Target> targets;  ///< in the order of the session
  std::size_t before_own = 0;   ///< how many of them come before the detector's own target
};

}  // namespace plenocal
