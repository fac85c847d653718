// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/shell/man_page.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <sstream>
#include <vector>

#include "apps/cli/shell/declarations.h"

namespace plenocal {
namespace {

/// Plain text in the language of man pages.
std::string Escaped(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '\\') {
      escaped += "\\e";
    } else if (c == '-') {
      escaped += "\\-";
    } else if (c == '\'') {
      escaped += "\\(aq";
    } else {
      escaped += c;
    }
  }
  // A dot at the beginning would be a request.
  return escaped.starts_with('.') ? "\\&" + escaped : escaped;
}

/// A description: lines that begin with blanks are examples, blank lines separate paragraphs.
std::string Paragraphs(const std::string& description) {
  std::string text;
  bool example = false;
  std::istringstream lines(description);
  for (std::string line; std::getline(lines, line);) {
    const bool is_example = line.starts_with("  ");
    if (is_example != example) text += is_example ? ".PP\n.nf\n.RS\n" : ".RE\n.fi\n";
    example = is_example;
    if (line.empty()) {
      text += ".PP\n";
    } else {
      text += Escaped(is_example ? line.substr(2) : line) + "\n";
    }
  }
  return example ? text + ".RE\n.fi\n" : text;
}

std::string ValueName(const DeclaredOption& option) {
  if (!option.takes_value) return {};
  if (option.choices.empty()) return " \\fIVALUE\\fR";
  return fmt::format(" \\fI{}\\fR", Escaped(fmt::format("{}", fmt::join(option.choices, "|"))));
}

std::string OptionsText(const std::vector<DeclaredOption>& options) {
  std::string text;
  for (const DeclaredOption& option : options) {
    std::string names;
    for (const std::string& name : option.names) {
      names += fmt::format("{}{}{}{}",
                           names.empty() ? "" : ", ",
                           option.positional ? "\\fI" : "\\fB",
                           Escaped(name),
                           "\\fR");
    }
    const std::string more =
        option.default_value.empty() ? "" : fmt::format(" (default: {})", option.default_value);
    text += fmt::format(".TP\n{}{}{}\n{}\n",
                        names,
                        option.positional ? "" : ValueName(option),
                        option.required ? " (required)" : "",
                        Escaped(option.help + more));
  }
  return text;
}

std::string Synopsis(const std::string& name, const CLI::App& app) {
  std::string text = fmt::format("\\fB{}\\fR [\\fIOPTIONS\\fR]", Escaped(name));
  for (const DeclaredOption& option : DeclaredOptions(app)) {
    if (!option.positional) continue;
    const std::string argument =
        fmt::format("\\fI{}\\fR{}", Escaped(option.names.front()), option.repeats ? "..." : "");
    text += option.required ? " " + argument : fmt::format(" [{}]", argument);
  }
  if (!DeclaredCommands(app).empty()) text += " \\fICOMMAND\\fR ...";
  return text + "\n";
}

std::string Page(const std::string& name, const std::string& title, const CLI::App& app) {
  std::string page = fmt::format(
      ".TH {} 1 \"\" \"plenocal {}\"\n.SH NAME\n{} \\- {}\n.SH SYNOPSIS\n{}.SH DESCRIPTION\n{}",
      Escaped(title),
      PLENOCAL_VERSION,
      Escaped(title),
      Escaped(Headline(app)),
      Synopsis(name, app),
      Paragraphs(app.get_description()));
  page += ".SH OPTIONS\n" + OptionsText(DeclaredOptions(app));
  for (const CLI::App* command : DeclaredCommands(app)) {
    if (app.get_parent() == nullptr) break;  // has pages of its own
    page += fmt::format(".SS {}\n{}{}",
                        Escaped(name + " " + command->get_name()),
                        Paragraphs(command->get_description()),
                        OptionsText(DeclaredOptions(*command)));
  }
  return page;
}

constexpr const char* kEnvironment =
    ".SH ENVIRONMENT\n"
    ".TP\n\\fBPLENOCAL_PLUGINS\\fR\n"
    "Shared libraries with more camera models, separated by colons, as with \\fB\\-\\-plugin\\fR.\n"
    ".TP\n\\fBNO_COLOR\\fR\nIf it is set, the output has no colours; with \\fBTERM=dumb\\fR neither.\n"
    ".SH EXIT STATUS\n"
    ".TP\n0\nDone.\n"
    ".TP\n1\nThe job failed, or a calibration does not hold any more; one line states the cause.\n"
    ".TP\n2\nThe command line or an input file is wrong.\n"
    ".TP\n3\nResults are written, but the verdict is worse than \\fB\\-\\-require\\fR, or an acceptance fails.\n"
    ".TP\n130\nInterrupted by Ctrl\\-C.\n";

}  // namespace

std::map<std::string, std::string> ManPages(const CLI::App& app) {
  std::map<std::string, std::string> pages;
  std::string commands = ".SH COMMANDS\n", see_also;
  for (const CLI::App* command : DeclaredCommands(app)) {
    const std::string name = app.get_name() + " " + command->get_name();
    const std::string title = app.get_name() + "-" + command->get_name();
    pages[title + ".1"] =
        Page(name, title, *command) + fmt::format(".SH SEE ALSO\n.BR {} (1)\n", app.get_name());
    commands += fmt::format(
        ".TP\n\\fB{}\\fR\n{}\n", Escaped(command->get_name()), Escaped(Headline(*command)));
    see_also += fmt::format(".BR {} (1)\n", Escaped(title));
  }
  pages[app.get_name() + ".1"] = Page(app.get_name(), app.get_name(), app) + commands +
                                 kEnvironment + ".SH SEE ALSO\n" + see_also;
  return pages;
}

}  // namespace plenocal
