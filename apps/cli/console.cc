// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/console.h"

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <utility>
#include <vector>

namespace plenocal {
namespace {

volatile std::sig_atomic_t interrupted = 0;

void OnInterrupt(int) { interrupted = 1; }

bool HasColours(int file) {
  const char* const no_color = std::getenv("NO_COLOR");
  const char* const term = std::getenv("TERM");
  return isatty(file) == 1 && (no_color == nullptr || *no_color == '\0') && term != nullptr &&
         std::string_view(term) != "dumb";
}

std::string_view ColourCode(Style style) {
  switch (style) {
    case Style::kHeading:
      return "\033[1m";  // bold
    case Style::kGood:
      return "\033[1;32m";  // green
    case Style::kWarning:
      return "\033[1;33m";  // yellow
    case Style::kError:
      return "\033[1;31m";  // red
  }
  return {};
}

// What a line of a result begins with, and its style; the rest of the line stays plain.
constexpr std::array<std::pair<std::string_view, Style>, 8> kBeginnings{
    {{"WARNING:", Style::kWarning},
     {"NOT DETERMINED", Style::kWarning},
     {"weakly determined", Style::kWarning},
     {"verdict: good", Style::kGood},
     {"verdict: usable", Style::kWarning},
     {"verdict: bad", Style::kError},
     {"recommended:", Style::kGood},
     {"  left out", Style::kWarning}}};

std::vector<std::string_view> LinesOf(std::string_view text) {
  std::vector<std::string_view> lines;
  while (!text.empty()) {
    const size_t end = std::min(text.find('\n'), text.size());
    lines.push_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

std::string ColouredLine(std::string_view line, std::string_view next) {
  for (const auto& [beginning, style] : kBeginnings) {
    if (!line.starts_with(beginning)) continue;
    return Styled(Stream::kOut, style, beginning).append(line.substr(beginning.size()));
  }
  const bool heading = !line.empty() && !line.starts_with(' ') && next.starts_with("  ");
  return heading ? Styled(Stream::kOut, Style::kHeading, line) : std::string(line);
}

}  // namespace

std::string Styled(Stream stream, Style style, std::string_view text) {
  static const bool out = HasColours(STDOUT_FILENO), err = HasColours(STDERR_FILENO);
  if (!(stream == Stream::kOut ? out : err)) return std::string(text);
  return fmt::format("{}{}\033[0m", ColourCode(style), text);
}

std::string WithColours(const std::string& text) {
  const std::vector<std::string_view> lines = LinesOf(text);
  std::string coloured;
  for (size_t i = 0; i < lines.size(); ++i) {
    coloured += ColouredLine(lines[i], i + 1 < lines.size() ? lines[i + 1] : "");
    coloured += '\n';
  }
  return coloured;
}

Console::Console(const ConsoleOptions& options)
    : quiet_(options.quiet), terminal_(isatty(STDERR_FILENO) == 1) {}

Console::~Console() { ClearLine(); }

void Console::ClearLine() {
  if (line_open_) std::fputs("\r\033[K", stderr);
  line_open_ = false;
}

void Console::Message(const std::string& line) {
  if (quiet_) return;
  ClearLine();
  fmt::print(stderr, "{}\n", line);
}

void Console::Progress(const std::string& stage, size_t done, size_t total) {
  Progress(fmt::format("{}: {} of {}", stage, done, total));
}

void Console::Progress(const std::string& stage) {
  if (quiet_ || !terminal_) return;
  fmt::print(stderr, "\r\033[K{}", stage);
  std::fflush(stderr);
  line_open_ = true;
}

void Console::Print(const std::string& text) {
  if (quiet_) return;
  ClearLine();
  fmt::print("{}", WithColours(text));
}

void CatchInterrupts() {
  struct sigaction action {};
  action.sa_handler = OnInterrupt;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool Interrupted() { return interrupted != 0; }

}  // namespace plenocal
