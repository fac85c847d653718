// SPDX-License-Identifier: Apache-2.0
//
// Simulation of a recording of a scene without a target.
#pragma once

#include <string>

#include "apps/simulate/spec/request.h"
#include "apps/simulate/spec/simulation_spec.h"

namespace plenocal::simulate {

/// Makes a recording of a scene with known truth in `request.out`; returns a summary. Throws
/// `Error`.
std::string SimulateScene(const SimulationSpec& spec,
                          const SimulateRequest& request,
                          const SimulateOptions& options,
                          const Progress& progress);

}  // namespace plenocal::simulate
