// SPDX-License-Identifier: Apache-2.0
//
// The commands of the program. Each is one file of apps/cli/commands, named after it:
// commands/try.cc defines `Command TryCommand()` with the help, the options and the work of
// `plenocal try`. CMake finds the files and generates the table `Commands()`, so a new command is a
// new file and edits no other.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>

namespace CLI {
class App;
}

namespace plenocal {

struct ConsoleOptions;

/// Runs a command whose options have been parsed. Throws `Error`, or `Stopped` after Ctrl-C.
using RunCommand = std::function<void()>;

/// `plenocal <name> ...`.
struct Command {
  std::string_view name;
  std::string help;  ///< description, example and results; `plenocal --help` shows it as well
  /// Declares the options on `app`, those that all commands share in `*shared`. Both outlive the
  /// function returned.
  std::function<RunCommand(CLI::App* app, ConsoleOptions* shared)> declare;
  bool shows_all = false;  ///< needs the options of all commands to be declared, too
};

/// All commands, in alphabetical order.
std::span<const Command> Commands();

}  // namespace plenocal
