// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

namespace plenocal {

/// Options that commands share.
struct ConsoleOptions {
  std::string program =
      "plenocal";      ///< the program as it was called, with the options before the command
  bool quiet = false;  ///< no messages, no progress
  int threads = 0;     ///< 0: all cores
};

/// Messages and progress on standard error. Progress is one line that is rewritten on a terminal,
/// and is not written to files; `quiet` silences both, but never errors.
class Console {
 public:
  explicit Console(const ConsoleOptions& options);
  ~Console();
  Console(const Console&) = delete;
  Console& operator=(const Console&) = delete;

  void Message(const std::string& line);
  /// `done` of `total` items of a stage.
  void Progress(const std::string& stage, size_t done, size_t total);
  void Progress(const std::string& stage);

 private:
  void ClearLine();

  bool quiet_;
  bool terminal_;
  bool line_open_ = false;
};

/// From now on Ctrl-C (SIGINT, also SIGTERM) sets `Interrupted()`; a second one kills the program.
void CatchInterrupts();
/// True once the user has pressed Ctrl-C: a running command throws `Stopped` as soon as it can.
bool Interrupted();

}  // namespace plenocal
