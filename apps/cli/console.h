// SPDX-License-Identifier: Apache-2.0
//
// The streams of the program: messages, progress and results in its terminal, and Ctrl-C.
#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

#include "calib/base/run.h"

namespace plenocal {

/// Options that commands share.
struct ConsoleOptions {
  std::string program =
      "plenocal";      ///< the program as it was called, with the options before the command
  bool quiet = false;  ///< errors only
  int threads = 0;     ///< 0: all cores
  int events = -1;     ///< open file that takes progress as JSON lines (docs/guide.md); -1: none
};

enum class Stream { kOut, kErr };
enum class Style { kHeading, kGood, kWarning, kError };

/// `text` in the colour of a style where the stream is a terminal with colours: not in a pipe, not
/// with TERM=dumb, not when NO_COLOR is set (no-color.org).
std::string Styled(Stream stream, Style style, std::string_view text);

/// `text` for standard output with its headings (lines above indented ones), warnings and grades in
/// colours, as `Styled`.
std::string WithColours(const std::string& text);

/// Messages and progress on standard error, and results that are also written to files on standard
/// output. Progress is one line that is rewritten on a terminal, and a line every ten seconds in a
/// file or pipe.
/// `quiet` silences all of it, but never errors, nor what a command prints by other means because
/// it is asked for.
class Console {
 public:
  explicit Console(const ConsoleOptions& options);
  ~Console();
  Console(const Console&) = delete;
  Console& operator=(const Console&) = delete;

  /// A line, whose control characters are shown escaped: names in it come from outside.
  void Message(const std::string& line);
  /// "  warning: ", in colour, and the line.
  void Warning(const std::string& line);
  /// `done` of `total` items of a stage; `total` 0: they are not counted. False after Ctrl-C.
  bool Progress(const std::string& stage, size_t done = 0, size_t total = 0);
  /// The points found in one image, for `ConsoleOptions::events` alone.
  void Detection(const std::string& camera,
                 const std::string& frame,
                 size_t points,
                 const std::string& why);
  /// Text of whole lines on standard output, with colours.
  void Print(const std::string& text);
  /// "written to " and the path, likewise.
  void PrintWritten(const std::filesystem::path& path);
  /// A run of the engine that reports here and stops after Ctrl-C. The console must outlive it.
  Run NewRun();

  [[nodiscard]] const ConsoleOptions& Options() const { return options_; }

 private:
  void ClearLine();
  void ProgressLine(const std::string& line);

  ConsoleOptions options_;
  Listener events_;  ///< `ConsoleOptions::events`
  bool terminal_;
  bool line_open_ = false;
  std::chrono::steady_clock::time_point next_line_;  ///< of progress, where there is no terminal
};

/// Exit statuses of the program (docs/formats.md) beside those of `ErrorKind`.
inline constexpr int kJobFailedStatus = 1;
inline constexpr int kInterruptedStatus = 130;  ///< as the shell's after Ctrl-C
inline constexpr const char* kInterrupted = "interrupted; no result files were written";

/// Opens those of the standard streams that are closed: at the start of the program, before files
/// are opened.
void OpenStandardStreams();

/// Writes what was printed so far. Throws `Error` of kind kJob where standard output takes no more.
void FlushOutput();

/// Writes text to standard error. Nothing happens where it is closed or full: a message that cannot
/// be shown is no reason to stop.
void PrintError(std::string_view text);

/// From now on Ctrl-C (SIGINT, also SIGTERM) sets `Interrupted()`, and ends the program within a
/// second where the work does not stop by itself, without the files that it has not committed. A
/// second one kills the program.
void CatchInterrupts();
/// True once the user has pressed Ctrl-C: a running command throws `Stopped` as soon as it can.
bool Interrupted();

}  // namespace plenocal
