// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/shell/declarations.h"
#include "apps/cli/shell/man_page.h"
#include "calib/base/format_error.h"
#include "calib/io/output_folder.h"

namespace plenocal {
namespace {

struct HelpArguments {
  std::vector<std::string> words;  ///< a command, and one below it; empty: the program
  std::filesystem::path man;       ///< folder for man pages; empty: none
};

const CLI::App& FindCommand(const CLI::App& app, const std::string& name) {
  const std::vector<const CLI::App*> commands = DeclaredCommands(app);
  std::vector<std::string_view> names;
  for (const CLI::App* command : commands) {
    if (command->get_name() == name) return *command;
    names.push_back(command->get_name());
  }
  throw InputError(
      "help: unknown command '{}'{}",
      name,
      names.empty() ? fmt::format("; '{}' has none", app.get_name()) : SuggestName(name, names));
}

void WriteManPages(const CLI::App& root, const std::filesystem::path& folder) {
  const auto pages = ManPages(root);
  WriteInto(folder, {pages.begin(), pages.end()});
}

void RunHelp(const HelpArguments& arguments, const CLI::App& root) {
  if (!arguments.man.empty()) return WriteManPages(root, arguments.man);
  const CLI::App* app = &root;
  std::string name = root.get_name();
  for (const std::string& word : arguments.words) {
    app = &FindCommand(*app, word);
    name += " " + word;
  }
  // Not `help()` of CLI11, which would show the command being run: this one.
  fmt::print("{}", app->get_formatter()->make_help(app, name, CLI::AppFormatMode::Normal));
}

constexpr const char* kHelpHelp =
    "The options of a command, as its --help.\n"
    "\n"
    "  plenocal help calibrate";

RunCommand DeclareHelp(CLI::App* app, ConsoleOptions* /*shared*/) {
  const auto arguments = std::make_shared<HelpArguments>();
  app->add_option("command", arguments->words, "the command (default: the list of commands)");
  app->add_option("--man", arguments->man, "folder for man pages of all commands")->group("");
  return [arguments, app] { RunHelp(*arguments, *app->get_parent()); };
}

}  // namespace

Command HelpCommand() { return {"help", kHelpHelp, DeclareHelp, /*shows_all=*/true}; }

}  // namespace plenocal
