// SPDX-License-Identifier: Apache-2.0
//
// The page that compares camera models.
#pragma once

#include <string>
#include <vector>

#include "assess/text/trial_text.h"

namespace plenocal {

/// What is recommended, each a sentence.
struct TrialRecommendations {
  std::string model, target;
};

/// HTML: the table, scores with their uncertainty, and of each model the residuals of held-out
/// points over the image, all at one scale. `rows` are in the order of `choice.trials`.
std::string TrialPage(const ModelChoice& choice,
                      const std::vector<TrialRow>& rows,
                      const TrialRecommendations& recommended);

}  // namespace plenocal
