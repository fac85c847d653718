// SPDX-License-Identifier: Apache-2.0
//
// Options and arguments of a command line, read from CLI11's declarations; completion and man
// pages are made of it, so that they have the words of `--help`.
#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace plenocal {

/// An option, or a positional argument.
struct DeclaredOption {
  std::vector<std::string> names;    ///< with their dashes; of a positional its name alone
  std::string help;                  ///< one line
  std::vector<std::string> choices;  ///< the only values allowed; empty: any
  std::string default_value;         ///< empty: none
  bool positional = false;
  bool takes_value = false;
  bool required = false;
  bool repeats = false;  ///< takes several values, or may stand several times
};

/// The visible options and positional arguments of a command, in the order of `--help`. The
/// argument of `plenocal help` has the commands for its choices.
std::vector<DeclaredOption> DeclaredOptions(const CLI::App& app);

/// The visible commands below another, in the order of `--help`.
std::vector<const CLI::App*> DeclaredCommands(const CLI::App& app);

/// The first line of a command's help, without the full stop.
std::string Headline(const CLI::App& app);

/// The names of all options of `app` that begin with "--".
std::vector<std::string> LongNames(const CLI::App& app);

}  // namespace plenocal
