// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

namespace plenocal {

/// Options that all commands share.
struct ConsoleOptions {
  std::string program = "plenocal";  ///< as it was called, with what stands before the command
  bool quiet = false;
  int threads = 0;  ///< 0: all cores
};

/// Messages and progress on standard error. Progress is one line that rewrites itself on a
/// terminal and nothing elsewhere; `quiet` silences both, but never errors.
class Console {
 public:
  explicit Console(bool quiet);
  ~Console();
  Console(const Console&) = delete;
  Console& operator=(const Console&) = delete;

  void Message(const std::string& line);
  /// `done` of `total` things of a stage.
  void Progress(const std::string& stage, size_t done, size_t total);
  void Progress(const std::string& stage);

 private:
  void ClearLine();

  bool quiet_;
  bool terminal_;
  bool line_open_ = false;
};

/// From now on Ctrl-C (SIGINT, also SIGTERM) asks the running command to stop; a second one kills.
void CatchInterrupts();
/// Whether the user has asked to stop.
bool Interrupted();

}  // namespace plenocal
