// SPDX-License-Identifier: Apache-2.0
//
// Fields of a form for what most users set in the texts of session and target.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "calib/io/yaml.h"

namespace plenocal::workbench {

/// The fields of a session: of each camera the model and what the model has to be told, and whether
/// the target is refined. Each has `path` (keys), `value`, `what`, `unit`, `required` and `choices`
/// (empty: any value). Values that are no scalar have none.
nlohmann::json SessionFields(const YamlNode& session);

/// Those of a target: its type, the keys of this type, and the tolerance.
nlohmann::json TargetFields(const YamlNode& target);

/// The text of a target with another type, without the keys that this type has not.
std::string WithTargetType(std::string text, const std::string& type);

}  // namespace plenocal::workbench
