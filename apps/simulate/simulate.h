// SPDX-License-Identifier: Apache-2.0
//
// Simulation of sessions and recordings whose truth is known (docs/simulate.md).
#pragma once

#include <string>

#include "apps/simulate/spec/request.h"

namespace plenocal {

/// Makes a session with known truth in `request.out`; returns a summary for the user. Throws
/// `Error`.
std::string Simulate(const SimulateRequest& request, const SimulateOptions& options);

}  // namespace plenocal
