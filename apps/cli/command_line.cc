// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/command_line.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <span>
#include <string_view>

#include "calib/base/error.h"
#include "calib/base/names.h"
#include "models/registry.h"

namespace plenocal {
namespace {

constexpr std::string_view kPlugin = "--plugin";

/// The arguments from the command on: those before it are `--plugin FILE`.
std::span<char*> FromCommand(int argc, char** argv) {
  std::span<char*> arguments(argv, static_cast<size_t>(argc));
  arguments = arguments.subspan(std::min<size_t>(1, arguments.size()));
  while (arguments.size() > 1 && arguments[0] == kPlugin) arguments = arguments.subspan(2);
  return arguments;
}

/// CLI11 would only report that a command is required.
void RefuseUnknownCommand(std::span<char*> arguments) {
  if (arguments.empty() || arguments[0][0] == '-') return;
  const std::vector<std::string_view> names = NamesOf(Commands());
  if (std::ranges::find(names, arguments[0]) != names.end()) return;
  throw Error(ErrorKind::kInput,
              fmt::format("unknown command '{}'{}; see 'plenocal --help'",
                          arguments[0],
                          SuggestName(arguments[0], names)));
}

[[noreturn]] void RefuseArguments(const CLI::App& app,
                                  const CLI::ParseError& error,
                                  std::span<char*> arguments) {
  const bool late_plugin = std::ranges::any_of(arguments, [](const char* argument) {
    return std::string_view(argument).starts_with(kPlugin);
  });
  if (late_plugin) {
    throw Error(ErrorKind::kInput,
                "--plugin stands before the command: plenocal --plugin ./libmine.so COMMAND ...");
  }
  const auto command = app.get_subcommands();
  throw Error(ErrorKind::kInput,
              fmt::format("{}; see 'plenocal {}--help'",
                          error.what(),
                          command.empty() ? "" : command[0]->get_name() + " "));
}

}  // namespace

CommandLine::CommandLine()
    : app_(std::make_unique<CLI::App>(
          "Plenocal calibrates ordinary and focused plenoptic cameras, alone or on one rig, from images of a target.\n\n"
          "  plenocal calibrate session.yaml -o OUT")) {
  app_->name("plenocal");
  app_->set_version_flag("--version", PLENOCAL_VERSION);
  app_->require_subcommand(1);
  app_->add_option(
          std::string(kPlugin),
          plugins_,
          "shared library with more camera models (docs/new_model.md); before the command, may stand several times")
      ->allow_extra_args(false);
  for (const Command& command : Commands()) {
    CLI::App* const declared = app_->add_subcommand(std::string(command.name), command.help);
    commands_[declared] = command.declare(declared, &shared_);
  }
}

CommandLine::~CommandLine() = default;

RunCommand CommandLine::Parse(int argc, char** argv) {
  const std::span<char*> arguments = FromCommand(argc, argv);
  RefuseUnknownCommand(arguments);
  try {
    app_->parse(argc, argv);
  } catch (const CLI::Success& help_or_version) {
    app_->exit(help_or_version);
    return {};
  } catch (const CLI::ParseError& error) {
    RefuseArguments(*app_, error, arguments);
  }
  return [this] {
    for (const std::string& plugin : plugins_) {
      AddCameraModels(plugin);
      shared_.program += fmt::format(" {} {}", kPlugin, plugin);
    }
    commands_.at(app_->get_subcommands().front())();
  };
}

}  // namespace plenocal
