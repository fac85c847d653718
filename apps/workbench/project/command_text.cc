// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/project/command_text.h"

namespace plenocal::workbench {

std::string CommandLineText(const std::vector<std::string>& arguments) {
  std::string text = "plenocal";
  for (const std::string& argument : arguments) {
    const bool plain =
        !argument.empty() &&
        argument.find_first_not_of(
            "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./:=,@%+") ==
            std::string::npos;
    text += ' ';
    if (plain) {
      text += argument;
      continue;
    }
    text += '\'';
    for (const char c : argument) text += c == '\'' ? "'\\''" : std::string(1, c);
    text += '\'';
  }
  return text;
}

std::string JobCommand(const nlohmann::json& job) {
  std::vector<std::string> arguments{job.at("kind"), job.at("input")};
  for (const auto& [key, value] : job.items()) {
    if (key == "kind" || key == "input") continue;
    arguments.push_back(key == "out" ? "-o" : "--" + key);
    arguments.push_back(value);
  }
  return CommandLineText(arguments);
}

}  // namespace plenocal::workbench
