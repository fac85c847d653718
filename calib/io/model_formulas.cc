// SPDX-License-Identifier: Apache-2.0
#include "calib/io/model_formulas.h"

#include <map>
#include <mutex>
#include <utility>

namespace plenocal {
namespace {

struct Formulas {
  std::mutex mutex;
  std::map<std::string, ModelFormula, std::less<>> by_model;
};

Formulas& AllFormulas() {
  static Formulas formulas;
  return formulas;
}

}  // namespace

void KeepModelFormula(std::string_view model, ModelFormula formula) {
  const std::lock_guard lock(AllFormulas().mutex);
  AllFormulas().by_model.insert_or_assign(std::string(model), std::move(formula));
}

std::optional<ModelFormula> FindModelFormula(std::string_view model) {
  const std::lock_guard lock(AllFormulas().mutex);
  const auto found = AllFormulas().by_model.find(model);
  if (found == AllFormulas().by_model.end()) return std::nullopt;
  return found->second;
}

}  // namespace plenocal
