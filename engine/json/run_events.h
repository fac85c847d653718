// SPDX-License-Identifier: Apache-2.0
//
// Writes what a run reports as JSON (docs/guide.md, "--events"), for programs that follow it.
#pragma once

#include <functional>
#include <nlohmann/json.hpp>

#include "calib/base/run.h"

namespace plenocal {

/// A listener that passes each report on as an event.
Listener EventListener(const std::function<void(const nlohmann::json& event)>& write);

}  // namespace plenocal
