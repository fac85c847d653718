// SPDX-License-Identifier: Apache-2.0
//
// The page that compares camera models.
#pragma once

#include <string>
#include <vector>

#include "calib/judge/model_trial.h"

namespace plenocal {

/// One model in the tables and on the page.
struct TrialRow {
  const ModelTrial* trial = nullptr;
  std::vector<std::string> undetermined;  ///< names of parameters
  bool recommended = false;
  std::string judgement;  ///< in comparison with the best model; empty when it has no score
  std::string why_not;    ///< why it has no score; empty when it has one
};

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
