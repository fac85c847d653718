// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include "assess/views/next_views.h"

namespace plenocal {

/// Suggestions as `plenocal suggest --json` prints them (docs/suggest.md). Numbers that are not
/// known are null.
nlohmann::json SuggestionsJson(const NextViews& suggestions, const RigKnowledge& rig);

}  // namespace plenocal
