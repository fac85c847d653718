// SPDX-License-Identifier: Apache-2.0
//
// Writes suggested views as JSON.
#pragma once

#include <nlohmann/json.hpp>

#include "engine/suggest_views.h"

namespace plenocal {

/// Suggestions as `plenocal suggest --json` prints them (docs/suggest.md). Numbers that are not
/// known are not finite: null in text.
nlohmann::json SuggestionsJson(const SuggestedViews& suggested);

}  // namespace plenocal
