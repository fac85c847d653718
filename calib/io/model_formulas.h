// SPDX-License-Identifier: Apache-2.0
//
// Texts of the camera models that were made from formulas (models/formula/): calibration.yaml
// carries those of the models that it uses.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace plenocal {

struct ModelFormula {
  std::string text;   ///< canonical YAML of the formula's keys
  std::string where;  ///< file and key from which it was read
};

/// Keeps a model's formula as long as the process, as models/registry.h keeps the model.
void KeepModelFormula(std::string_view model, ModelFormula formula);

/// Nothing for models that are made of none.
std::optional<ModelFormula> FindModelFormula(std::string_view model);

}  // namespace plenocal
