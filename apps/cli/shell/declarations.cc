// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/shell/declarations.h"

#include <CLI/CLI.hpp>

namespace plenocal {
namespace {

/// CLI11 shows the values of `CLI::IsMember` in the option's type: "TEXT:{linear,cubic}".
std::vector<std::string> Choices(const std::string& type) {
  const size_t open = type.find('{'), close = type.find('}', open);
  if (open == std::string::npos || close == std::string::npos) return {};
  return CLI::detail::split(type.substr(open + 1, close - open - 1), ',');
}

DeclaredOption Declared(const CLI::Option& option) {
  constexpr int kMany = 2;
  DeclaredOption declared;
  declared.positional = option.get_positional();
  if (declared.positional) {
    declared.names = {option.get_name(/*positional=*/true)};
  } else {
    for (const std::string& name : option.get_snames()) declared.names.push_back("-" + name);
    for (const std::string& name : option.get_lnames()) declared.names.push_back("--" + name);
  }
  declared.help = option.get_description();
  declared.choices = Choices(option.get_type_name());
  declared.default_value = option.get_default_str();
  declared.takes_value = option.get_items_expected_max() > 0;
  declared.required = option.get_required();
  declared.repeats = option.get_items_expected_max() >= kMany;
  return declared;
}

}  // namespace

std::vector<DeclaredOption> DeclaredOptions(const CLI::App& app) {
  std::vector<DeclaredOption> declared;
  for (const CLI::Option* option : app.get_options()) {
    if (!option->get_group().empty()) declared.push_back(Declared(*option));
  }
  if (app.get_name() == "help" && app.get_parent() != nullptr) {
    for (DeclaredOption& option : declared) {
      if (!option.positional) continue;
      for (const CLI::App* command : DeclaredCommands(*app.get_parent())) {
        option.choices.push_back(command->get_name());
      }
    }
  }
  return declared;
}

std::vector<const CLI::App*> DeclaredCommands(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* command) { return !command->get_group().empty(); });
}

std::string Headline(const CLI::App& app) {
  std::string line = app.get_description();
  line = line.substr(0, line.find('\n'));
  if (line.ends_with('.')) line.pop_back();
  return line;
}

std::vector<std::string> LongNames(const CLI::App& app) {
  std::vector<std::string> names;
  for (const DeclaredOption& option : DeclaredOptions(app)) {
    for (const std::string& name : option.names) {
      if (name.starts_with("--")) names.push_back(name);
    }
  }
  return names;
}

}  // namespace plenocal
