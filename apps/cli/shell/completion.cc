// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/shell/completion.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <vector>

#include "apps/cli/shell/declarations.h"

namespace plenocal {
namespace {

std::vector<std::string> Names(const std::vector<const CLI::App*>& commands) {
  std::vector<std::string> names;
  for (const CLI::App* command : commands) names.push_back(command->get_name());
  return names;
}

/// The words that may stand as positional arguments: commands below this one, fixed values.
std::vector<std::string> PositionalWords(const CLI::App& app) {
  std::vector<std::string> words = Names(DeclaredCommands(app));
  for (const DeclaredOption& option : DeclaredOptions(app)) {
    if (option.positional) words.insert(words.end(), option.choices.begin(), option.choices.end());
  }
  return words;
}

/// The branch of bash's `case $command`: sets options, words, and words again where the option
/// before the cursor has fixed values, or none where it takes any (bash then completes files).
std::string BashBranch(const std::string& pattern, const CLI::App& app) {
  std::vector<std::string> options;
  std::string values;
  for (const DeclaredOption& option : DeclaredOptions(app)) {
    if (option.positional) continue;
    options.insert(options.end(), option.names.begin(), option.names.end());
    if (!option.takes_value) continue;
    values += fmt::format("        {}) options= words='{}' ;;\n",
                          fmt::join(option.names, "|"),
                          fmt::join(option.choices, " "));
  }
  std::string branch = fmt::format("    {})\n      options='{}'\n      words='{}'\n",
                                   pattern,
                                   fmt::join(options, " "),
                                   fmt::join(PositionalWords(app), " "));
  if (!values.empty()) branch += fmt::format("      case $previous in\n{}      esac\n", values);
  return branch + "      ;;\n";
}

constexpr const char* kBashHead =
    R"(# Completion of plenocal for bash; made by 'plenocal completion bash'.
_plenocal() {
  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]}
  local command= options= words= i
  for ((i = 1; i < COMP_CWORD; ++i)); do
    case ${COMP_WORDS[i]} in
      --plugin | --model-file) ((++i)) ;;
      -*) ;;
      *) command=${COMP_WORDS[i]}; break ;;
    esac
  done
  case $command in
)";
constexpr const char* kBashTail = R"(  esac
  if [[ $current == -* ]]; then words=$options; fi
  COMPREPLY=($(compgen -W "$words" -- "$current"))
}
complete -o default -F _plenocal plenocal
)";

/// Text within the single quotes of a zsh string.
std::string ZshQuoted(const std::string& text) {
  std::string quoted;
  for (const char c : text) quoted += c == '\'' ? "'\\''" : std::string(1, c);
  return quoted;
}

/// Text within an argument of zsh's `_arguments`, in which : [ ] and \ have a meaning.
std::string ZshEscaped(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == ':' || c == '[' || c == ']' || c == '\\') escaped += '\\';
    escaped += c;
  }
  return ZshQuoted(escaped);
}

std::string ZshValue(const DeclaredOption& option) {
  return option.choices.empty() ? "_files" : fmt::format("({})", fmt::join(option.choices, " "));
}

std::string ZshArgument(const DeclaredOption& option) {
  const std::string help = ZshEscaped(option.help);
  if (option.positional) {
    return fmt::format("'{}:{}:{}'",
                       option.repeats ? "*" : "",
                       ZshEscaped(option.names.front()),
                       ZshValue(option));
  }
  const std::string value =
      option.takes_value ? fmt::format(":value:{}", ZshValue(option)) : std::string();
  const std::string names = option.names.size() == 1
                                ? option.names[0]
                                : fmt::format("'{{{}}}'", fmt::join(option.names, ","));
  const std::string exclusion =
      option.repeats ? "*" : fmt::format("({})", fmt::join(option.names, " "));
  return fmt::format("'{}{}[{}]{}'", exclusion, names, help, value);
}

std::string ZshBranch(const CLI::App& app) {
  std::string arguments;
  const std::vector<std::string> words = PositionalWords(app);
  for (const DeclaredOption& option : DeclaredOptions(app)) {
    // Commands below this one take the place of the words.
    if (option.positional && !DeclaredCommands(app).empty()) continue;
    arguments += fmt::format(" \\\n            {}", ZshArgument(option));
  }
  if (!DeclaredCommands(app).empty()) {
    arguments += fmt::format(" \\\n            '*:command:({})'", fmt::join(words, " "));
  }
  return fmt::format(
      "        {})\n          _arguments{}\n          ;;\n", app.get_name(), arguments);
}

constexpr const char* kZshHead = R"(#compdef plenocal
# Completion of plenocal for zsh; made by 'plenocal completion zsh'.
_plenocal() {
  local curcontext=$curcontext context state state_descr line
  typeset -A opt_args
)";
constexpr const char* kZshCommands = R"(
  case $state in
    command)
      local -a commands=(
)";
constexpr const char* kZshArguments = R"(      )
      _describe command commands
      ;;
    argument)
      case $words[1] in
)";
constexpr const char* kZshTail = R"(      esac
      ;;
  esac
}
_plenocal "$@"
)";

}  // namespace

std::string BashCompletion(const CLI::App& app) {
  std::string script = kBashHead + BashBranch("''", app);
  for (const CLI::App* command : DeclaredCommands(app)) {
    script += BashBranch(command->get_name(), *command);
  }
  return script + kBashTail;
}

std::string ZshCompletion(const CLI::App& app) {
  std::string script = fmt::format("{}  _arguments -C", kZshHead);
  for (const DeclaredOption& option : DeclaredOptions(app)) {
    script += fmt::format(" \\\n    {}", ZshArgument(option));
  }
  script += " \\\n    '1:command:->command' '*::argument:->argument'\n";
  script += kZshCommands;
  for (const CLI::App* command : DeclaredCommands(app)) {
    script += fmt::format("        '{}:{}'\n", command->get_name(), ZshQuoted(Headline(*command)));
  }
  script += kZshArguments;
  for (const CLI::App* command : DeclaredCommands(app)) script += ZshBranch(*command);
  return script + kZshTail;
}

}  // namespace plenocal
