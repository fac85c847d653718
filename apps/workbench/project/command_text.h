// SPDX-License-Identifier: Apache-2.0
//
// Writes the command lines that do what the workbench does, for the page to show.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace plenocal::workbench {

/// A command line that a shell takes as these arguments.
std::string CommandLineText(const std::vector<std::string>& arguments);

/// That of a job (`RunJob`).
std::string JobCommand(const nlohmann::json& job);

}  // namespace plenocal::workbench
