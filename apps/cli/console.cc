// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/console.h"

#include <fmt/format.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>

namespace plenocal {
namespace {

volatile std::sig_atomic_t interrupted = 0;

void OnInterrupt(int) { interrupted = 1; }

}  // namespace

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
  Progress(fmt::format("{}  {}/{}", stage, done, total));
}

void Console::Progress(const std::string& stage) {
  if (quiet_ || !terminal_) return;
  fmt::print(stderr, "\r\033[K{}", stage);
  std::fflush(stderr);
  line_open_ = true;
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
