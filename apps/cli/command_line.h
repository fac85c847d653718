// SPDX-License-Identifier: Apache-2.0
//
// The command line of the program, parsed into the command to run.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "apps/cli/command.h"
#include "apps/cli/console.h"

namespace plenocal {

/// The arguments of the program: `--plugin` and `--model-file` before the command, the command and its options.
class CommandLine {
 public:
  CommandLine();
  ~CommandLine();

  /// Runs the command that the arguments name, with its options; empty after `--help` and
  /// `--version`, which are printed. Throws `Error` of kind kInput for arguments that do not fit.
  /// This object must outlive the function returned.
  RunCommand Parse(int argc, char** argv);

 private:
  /// Declares all commands, with options the one of that name, or all when none has it.
  void Declare(std::string_view named);

  std::unique_ptr<CLI::App> app_;
  ConsoleOptions shared_;
  std::vector<std::string> plugins_, model_files_;
  std::map<const CLI::App*, RunCommand> commands_;
};

}  // namespace plenocal
