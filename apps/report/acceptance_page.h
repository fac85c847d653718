// SPDX-License-Identifier: Apache-2.0
//
// The page of `plenocal accept`, to be printed.
#pragma once

#include <string>

#include "engine/rigs/accept_lengths.h"

namespace plenocal {

/// acceptance.html: pass or fail, deviations against their limits, all lengths.
std::string AcceptancePage(const Acceptance& acceptance);

}  // namespace plenocal
