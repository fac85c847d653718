// SPDX-License-Identifier: Apache-2.0
//
// Trials of camera models in words and tables.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "assess/model_trial.h"
#include "assess/stress/stress.h"

namespace plenocal {

/// One model in the tables and on the page.
struct TrialRow {
  const ModelTrial* trial = nullptr;
  bool recommended = false;
  std::string judgement;  ///< in comparison with the best model; empty when it has no score
  std::string why_not;    ///< why it has no score; empty when it has one
};

/// In the order of `choice.trials`, to which they point.
std::vector<TrialRow> MakeRows(const ModelChoice& choice);

/// The recommended model, and why, in a sentence.
std::string ModelRecommendation(const ModelChoice& choice);
/// "With 90 % the best model is one of: a, b." Empty where one model can be compared.
std::string ConfidenceText(const ModelChoice& choice);
/// "rigid" or "refined".
std::string_view TargetName(const ModelTrial& trial);
/// Whether the target's markers are to be refined, and why. `session_sigma`: what the session gives
/// its markers, m.
std::string TargetRecommendation(const ModelChoice& targets, MarkerFreedom of_session);

/// For the terminal.
std::string TrialTable(const ModelChoice& choice, const std::vector<TrialRow>& rows);
/// Table and reading of stress tests, for the terminal; empty without tests.
std::string StressText(const std::vector<StressTest>& stress);
/// Content of try.csv.
std::string TrialCsv(const std::vector<TrialRow>& rows);

}  // namespace plenocal
