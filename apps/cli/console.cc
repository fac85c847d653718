// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/console.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>
#include <stop_token>
#include <thread>
#include <utility>
#include <vector>

#include "calib/base/format_error.h"
#include "calib/base/json_text.h"
#include "calib/base/quoted_text.h"
#include "calib/io/output_folder.h"
#include "engine/json/run_events.h"

namespace plenocal {
namespace {

// Requested after Ctrl-C.
std::stop_source& Interruption() {
  static std::stop_source source;
  return source;
}
constexpr auto kLogPause = std::chrono::seconds(10);  // between lines of progress in a file
int wake_up[2] = {-1, -1};  // a pipe from the signal handler to `EndWhenInterrupted`

void OnInterrupt(int) {
  const char byte = 0;
  // Nothing can be done here when it fails; the second Ctrl-C kills.
  if (write(wake_up[1], &byte, 1) < 0) return;
}

// Stops all runs, and ends the program for work that does not stop within a moment.
void EndWhenInterrupted() {
  char byte = 0;
  while (read(wake_up[0], &byte, 1) != 1) {
    if (errno != EINTR) return;
  }
  Interruption().request_stop();
  constexpr auto kPatience = std::chrono::milliseconds(600);
  std::this_thread::sleep_for(kPatience);
  AbandonOutput();
  PrintError(
      fmt::format("{} {}\n", Styled(Stream::kErr, Style::kError, "plenocal:"), kInterrupted));
  _exit(kInterruptedStatus);
}

// A copy of standard error as it was at the start: decoders of images have it closed to them.
int ErrorFile() {
  static const int kFile = fcntl(STDERR_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
  return kFile;
}

// As far as the file takes it.
void WriteAll(int file, std::string_view text) {
  while (!text.empty()) {
    const ssize_t count = write(file, text.data(), text.size());
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return;
    text.remove_prefix(static_cast<size_t>(count));
  }
}

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

// Beginnings of lines of a result, and their styles; the rest of the line stays plain.
constexpr std::array<std::pair<std::string_view, Style>, 7> kBeginnings{
    {{"WARNING:", Style::kWarning},
     {"NOT DETERMINED", Style::kWarning},
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
  static const bool kOut = HasColours(STDOUT_FILENO), kErr = HasColours(ErrorFile());
  if (!(stream == Stream::kOut ? kOut : kErr)) return std::string(text);
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
    : options_(options),
      terminal_(isatty(ErrorFile()) == 1),
      next_line_(std::chrono::steady_clock::now() + kLogPause) {
  if (options.events < 0) return;
  // Where nobody reads, the work goes on.
  events_ = EventListener([file = options.events](const nlohmann::json& event) {
    WriteAll(file, JsonText(event, -1) + "\n");
  });
}

Console::~Console() { ClearLine(); }

void Console::ClearLine() {
  if (line_open_) PrintError("\r\033[K");
  line_open_ = false;
}

void Console::Message(const std::string& line) {
  if (events_.message) events_.message(line);
  if (options_.quiet) return;
  ClearLine();
  PrintError(Escaped(line) + "\n");
}

void Console::Detection(const std::string& camera,
                        const std::string& frame,
                        size_t points,
                        const std::string& why) {
  if (events_.detection) events_.detection(camera, frame, points, why);
}

void Console::Warning(const std::string& line) {
  if (events_.warning) events_.warning(line);
  if (options_.quiet) return;
  ClearLine();
  PrintError(
      fmt::format("  {} {}\n", Styled(Stream::kErr, Style::kWarning, "warning:"), Escaped(line)));
}

bool Console::Progress(const std::string& stage, size_t done, size_t total) {
  if (events_.progress) events_.progress(stage, done, total);
  ProgressLine(total > 0 ? fmt::format("{}: {} of {}", stage, done, total) : stage);
  return !Interrupted();
}

void Console::ProgressLine(const std::string& stage) {
  if (options_.quiet) return;
  if (terminal_) {
    PrintError(fmt::format("\r\033[K{}", Escaped(stage)));
    line_open_ = true;
  } else if (const auto now = std::chrono::steady_clock::now(); now >= next_line_) {
    PrintError(Escaped(stage) + "\n");
    next_line_ = now + kLogPause;
  }
}

void Console::Print(const std::string& text) {
  if (options_.quiet) return;
  ClearLine();
  fmt::print("{}", WithColours(Escaped(text, "\n")));
}

void Console::PrintWritten(const std::filesystem::path& path) {
  Print(fmt::format("written to {}\n", path.string()));
}

Run Console::NewRun() {
  return {
      .listener = {
          .message = [this](const std::string& line) { Message(line); },
          .warning = [this](const std::string& line) { Warning(line); },
          .progress = [this](const std::string& stage,
                             size_t done,
                             size_t total) { Progress(stage, done, total); },
          .detection = [this](const std::string& camera,
                              const std::string& frame,
                              size_t points,
                              const std::string& why) { Detection(camera, frame, points, why); }},
      .stop = Interruption().get_token(),
      .threads = options_.threads};
}

void OpenStandardStreams() {
  for (const int file : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    // The lowest free number is given: a result file must not get that of a stream. What is written
    // there is reported as on a full disk, hence read-only.
    if (fcntl(file, F_GETFD) == -1 && open("/dev/null", O_RDONLY) != file) _exit(kJobFailedStatus);
  }
  ErrorFile();
}

void FlushOutput() {
  if (std::fflush(stdout) == 0) return;
  throw JobError("cannot write to standard output: {}", std::strerror(errno));
}

void PrintError(std::string_view text) { WriteAll(ErrorFile(), text); }

void CatchInterrupts() {
  if (pipe2(wake_up, O_CLOEXEC) == 0) std::thread(EndWhenInterrupted).detach();
  struct sigaction action {};
  action.sa_handler = OnInterrupt;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool Interrupted() { return Interruption().stop_requested(); }

}  // namespace plenocal
