// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/shell/completion.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>

#include "apps/cli/command.h"

namespace plenocal {
namespace {

constexpr const char* kCompletionHelp =
    "A script that completes commands and options in a shell.\n"
    "\n"
    "  source <(plenocal completion bash)\n"
    "  plenocal completion zsh > ~/.zfunc/_plenocal\n"
    "\n"
    "An installed program has both scripts where the shells look for them.";

RunCommand DeclareCompletion(CLI::App* app, ConsoleOptions* /*shared*/) {
  const auto shell = std::make_shared<std::string>();
  app->add_option("shell", *shell, "the shell")
      ->required()
      ->check(CLI::IsMember(std::vector<std::string>{"bash", "zsh"}));
  return [shell, app] {
    const CLI::App& root = *app->get_parent();
    fmt::print("{}", *shell == "bash" ? BashCompletion(root) : ZshCompletion(root));
  };
}

}  // namespace

Command CompletionCommand() {
  return {"completion", kCompletionHelp, DeclareCompletion, /*shows_all=*/true};
}

}  // namespace plenocal
