// SPDX-License-Identifier: Apache-2.0
//
// Makes the page that compares camera models.
#pragma once

#include <string>

#include "engine/try_session.h"

namespace plenocal {

/// HTML: the table, scores with their uncertainty, and of each model the residuals of held-out
/// points over the image, all at one scale.
std::string TrialPage(const SessionTrial& trial);

}  // namespace plenocal
