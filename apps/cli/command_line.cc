// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/command_line.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <span>
#include <sstream>
#include <string_view>

#include "apps/cli/shell/declarations.h"
#include "apps/cli/shell/version.h"
#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "models/formula/model.h"
#include "models/registry.h"

namespace plenocal {
namespace {

constexpr std::string_view kPlugin = "--plugin";
constexpr std::string_view kModelFile = "--model-file";
constexpr const char* kPluginVariable = "PLENOCAL_PLUGINS";  // files, separated by colons

/// The arguments from the command on: those before it are `--plugin FILE` and `--model-file FILE`.
std::span<char*> FromCommand(int argc, char** argv) {
  std::span<char*> arguments(argv, static_cast<size_t>(argc));
  arguments = arguments.subspan(std::min<size_t>(1, arguments.size()));
  while (arguments.size() > 1 && (arguments[0] == kPlugin || arguments[0] == kModelFile)) {
    arguments = arguments.subspan(2);
  }
  return arguments;
}

/// CLI11 would only report that a command is required.
void RefuseUnknownCommand(std::span<char*> arguments) {
  if (arguments.empty() || arguments[0][0] == '-') return;
  const std::vector<std::string_view> names = NamesOf(Commands());
  if (std::ranges::find(names, arguments[0]) != names.end()) return;
  throw InputError("unknown command '{}'{}; see 'plenocal --help'",
                   arguments[0],
                   SuggestName(arguments[0], names));
}

/// An unknown option, with the nearest known one: it would else be reported by its consequences.
void RefuseUnknownOption(const CLI::App& command, const std::string& path) {
  for (const std::string& argument : command.remaining()) {
    if (argument.size() < 2 || argument[0] != '-' || ParseDouble(argument)) continue;
    const std::string option = argument.substr(0, argument.find('='));
    const std::vector<std::string> names = LongNames(command);
    const std::vector<std::string_view> known(names.begin(), names.end());
    const std::string_view nearest = NearestName(option, known);
    throw InputError("unknown option '{}'{}; see '{} --help'",
                     option,
                     nearest.empty() ? "" : fmt::format("; did you mean '{}'?", nearest),
                     path);
  }
}

/// "nan" and "inf" are numbers for CLI11, and pass its ranges; no option means them.
void RefuseInfiniteNumbers(const CLI::App& command) {
  for (const CLI::Option* option : command.get_options()) {
    if (option->get_type_name().find("FLOAT") == std::string::npos) continue;
    for (const std::string& result : option->results()) {
      const std::optional<double> value = ParseDouble(result);
      if (!value || std::isfinite(*value)) continue;
      throw InputError("{}: expected a finite number, found '{}'", option->get_name(), result);
    }
  }
}

/// An unset variable of a script gives an empty text, which would name the working folder or
/// nothing.
void RefuseEmptyTexts(const CLI::App& command) {
  for (const CLI::Option* option : command.get_options()) {
    // Some options may stand without a value.
    if (option->get_expected_min() == 0) continue;
    if (std::ranges::find(option->results(), "") == option->results().end()) continue;
    throw InputError("{}: is empty; give a value or leave it out", option->get_name());
  }
}

[[noreturn]] void RefuseArguments(const CLI::App& app,
                                  const CLI::ParseError& error,
                                  std::span<char*> arguments) {
  for (const std::string_view argument : arguments) {
    if (argument.starts_with(kPlugin)) {
      throw InputError(
          "--plugin stands before the command: plenocal --plugin ./libmine.so COMMAND ...");
    }
    if (argument.starts_with(kModelFile)) {
      throw InputError(
          "--model-file stands before the command: plenocal --model-file mine.model.yaml COMMAND "
          "...");
    }
  }
  const CLI::App* command = &app;
  std::string path = app.get_name();
  RefuseUnknownOption(*command, path);
  while (!command->get_subcommands().empty()) {
    command = command->get_subcommands().front();
    path += " " + command->get_name();
    RefuseUnknownOption(*command, path);
  }
  throw InputError("{}; see '{} --help'", error.what(), path);
}

/// The plug-ins that the environment names, without those that the command line names as well.
std::vector<std::string> PluginsOfEnvironment(const std::vector<std::string>& named) {
  const char* const list = std::getenv(kPluginVariable);
  if (list == nullptr) return {};
  std::vector<std::string> plugins;
  for (const std::string& plugin : CLI::detail::split(list, ':')) {
    const auto is_same = [&](const std::string& other) {
      std::error_code error;
      return std::filesystem::equivalent(plugin, other, error);
    };
    if (plugin.empty() || std::ranges::any_of(named, is_same) ||
        std::ranges::any_of(plugins, is_same)) {
      continue;
    }
    plugins.push_back(plugin);
  }
  return plugins;
}

void AddModelsOfEnvironment(const std::string& plugin) {
  try {
    AddCameraModels(plugin);
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("{}: {}", kPluginVariable, error.what()));
  }
}

}  // namespace

CommandLine::CommandLine()
    : app_(std::make_unique<CLI::App>(
          "Plenocal calibrates ordinary and focused plenoptic cameras, alone or on one rig, from images of a target.\n\n"
          "  plenocal calibrate session.yaml -o OUT")) {
  app_->name("plenocal");
  app_->set_version_flag(
      "--version", VersionText, "version and commit of the program, versions of its libraries");
  app_->require_subcommand(1);
  app_->add_option(
          std::string(kPlugin),
          plugins_,
          "shared library with more camera models (docs/new_model.md); before the command, may stand several times; the environment variable PLENOCAL_PLUGINS names more, separated by colons")
      ->allow_extra_args(false);
  app_->add_option(
          std::string(kModelFile),
          model_files_,
          "file with formulas of camera models (docs/new_model.md); before the command, may stand several times")
      ->allow_extra_args(false);
}

CommandLine::~CommandLine() = default;

// Only the options that can be used: all of them, some hundreds, take half a millisecond.
void CommandLine::Declare(std::string_view named) {
  const auto found = std::ranges::find(Commands(), named, &Command::name);
  const bool all = found == Commands().end() || found->shows_all;
  for (const Command& command : Commands()) {
    CLI::App* const app = app_->add_subcommand(std::string(command.name), command.help);
    if (all || command.name == named) commands_[app] = command.declare(app, &shared_);
  }
}

RunCommand CommandLine::Parse(int argc, char** argv) {
  const std::span<char*> arguments = FromCommand(argc, argv);
  RefuseUnknownCommand(arguments);
  Declare(arguments.empty() ? std::string_view() : arguments[0]);
  try {
    app_->parse(argc, argv);
  } catch (const CLI::Success& help_or_version) {
    std::ostringstream text;
    app_->exit(help_or_version, text);
    fmt::print("{}", text.str());
    return {};
  } catch (const CLI::ParseError& error) {
    RefuseArguments(*app_, error, arguments);
  }
  for (const CLI::App* command : app_->get_subcommands()) {
    RefuseInfiniteNumbers(*command);
    RefuseEmptyTexts(*command);
  }
  return [this] {
    const std::vector<std::string> more = PluginsOfEnvironment(plugins_);
    for (const std::string& plugin : more) AddModelsOfEnvironment(plugin);
    for (const std::string& plugin : plugins_) AddCameraModels(plugin);
    for (const std::string& file : model_files_) AddModelFile(file);
    for (const auto& plugins : {more, plugins_}) {
      for (const std::string& plugin : plugins) {
        shared_.program += fmt::format(" {} {}", kPlugin, plugin);
      }
    }
    for (const std::string& file : model_files_) {
      shared_.program += fmt::format(" {} {}", kModelFile, file);
    }
    commands_.at(app_->get_subcommands().front())();
  };
}

}  // namespace plenocal
