// SPDX-License-Identifier: Apache-2.0
#include "apps/cli/program.h"

#include <fmt/format.h>
#include <glog/logging.h>
#include <malloc.h>

#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <new>
#include <span>
#include <string_view>
#include <system_error>

#include "apps/cli/command_line.h"
#include "apps/cli/console.h"
#include "calib/base/error.h"
#include "calib/base/quoted_text.h"
#include "calib/io/input_file.h"
#include "calib/io/output_folder.h"

namespace plenocal {
namespace {

int Fail(int status, std::string_view message) {
  PrintError(
      fmt::format("{} {}\n", Styled(Stream::kErr, Style::kError, "plenocal:"), Escaped(message)));
  return status;
}

int StatusOf(ErrorKind kind) {
  constexpr int kWrongInput = 2, kBelowRequiredGrade = 3;
  switch (kind) {
    case ErrorKind::kInput:
      return kWrongInput;
    case ErrorKind::kJob:
      return kJobFailedStatus;
    case ErrorKind::kGrade:
      return kBelowRequiredGrade;
  }
  return kJobFailedStatus;
}

/// The C library would return each image and matrix that is released to the system, whose pages are
/// filled with zeros for the next one: a tenth of the CPU time of most commands.
void KeepReleasedMemory() {
  constexpr int kBytes = 256 << 20;
  mallopt(M_MMAP_THRESHOLD, kBytes);
  mallopt(M_TRIM_THRESHOLD, kBytes);
}

/// A write into a closed pipe or behind a limit for the size of files ends in a message. Handled
/// and not ignored: programs that this one starts would inherit that.
void SurviveFailedWrites() {
  struct sigaction action {};
  action.sa_handler = [](int) {};
  action.sa_flags = SA_RESTART;
  for (const int signal : {SIGPIPE, SIGXFSZ}) sigaction(signal, &action, nullptr);
}

int ParseAndRun(int argc, char** argv) {
  constexpr int kFailed = kJobFailedStatus;
  try {
    CommandLine command_line;
    const RunCommand run = command_line.Parse(argc, argv);
    CatchInterrupts();
    const RunScope inputs;
    if (run) {
      for (const char* const argument : std::span(argv, static_cast<size_t>(argc)).subspan(1)) {
        CompleteResults(argument);  // of a killed run, among which an input may lie
      }
      run();
    }
    // Printed text is a result: a full disk behind a redirection is a failure.
    FlushOutput();
    return 0;
  } catch (const Error& error) {
    return Fail(StatusOf(error.kind()), error.what());
  } catch (const Stopped&) {
    return Fail(kInterruptedStatus, kInterrupted);
  } catch (const std::bad_alloc&) {
    return Fail(kFailed, "out of memory");
  } catch (const std::filesystem::filesystem_error& error) {
    return Fail(kFailed, fmt::format("{}: {}", error.path1().string(), error.code().message()));
  } catch (const std::system_error& error) {
    // Thrown by fmt::print; files have errors of their own.
    return Fail(kFailed, fmt::format("standard output: {}", error.what()));
  } catch (const std::exception& error) {
    return Fail(kFailed, fmt::format("internal error: {}", error.what()));
  }
}

}  // namespace

void SilenceSolver() { FLAGS_minloglevel = google::GLOG_FATAL; }

int RunProgram(int argc, char** argv) {
  KeepReleasedMemory();
  SurviveFailedWrites();
  OpenStandardStreams();
  SilenceSolver();
  return ParseAndRun(argc, argv);
}

}  // namespace plenocal
