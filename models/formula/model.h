// SPDX-License-Identifier: Apache-2.0
//
// Camera models from formulas in YAML files.
#pragma once

#include <filesystem>
#include <string>

#include "calib/camera/camera_model.h"
#include "calib/io/yaml.h"

namespace plenocal {

/// Adds the model `name` of a formula (docs/new_model.md) to the registry; one that is there from
/// the same text is returned. `file` begins messages about two formulas of one name. Throws `Error`
/// of kind kInput with file, line and key.
const CameraModel& AddFormulaModel(const std::string& name,
                                   const YamlNode& node,
                                   const std::filesystem::path& file);

/// Throws as `AddFormulaModel` where a formula makes no model, and adds none.
void CheckFormula(const YamlNode& node);

/// A C++ header for models/ of the same meaning as a model from a formula. Throws likewise for
/// other models, and for formulas without closed inverse.
std::string FormulaHeader(const CameraModel& model);

/// Adds the models in the key `models` of a file, if it has one: a session, a calibration or a
/// file of formulas alone. It is a map of formulas or a list of files with one. Throws likewise.
void AddFormulaModels(const std::filesystem::path& file);

/// Likewise of a file that must have the key and no other.
void AddModelFile(const std::filesystem::path& file);

}  // namespace plenocal
