// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "apps/simulate/observer.h"
#include "apps/simulate/simulate.h"
#include "apps/simulate/simulation_spec.h"

namespace plenocal::simulate {

/// Makes a recording of a scene with known truth in `request.out`; returns a summary. `progress`
/// is called with the stage and its items done. Throws `Error`.
std::string SimulateScene(
    const SimulationSpec& spec,
    const SimulateRequest& request,
    const SimulateOptions& options,
    const std::function<void(const std::string& stage, size_t done, size_t total)>& progress);

}  // namespace plenocal::simulate
