// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <glog/logging.h>

#include <cstdio>
#include <exception>
#include <new>
#include <string_view>
#include <system_error>

#include "apps/cli/command_line.h"
#include "apps/cli/console.h"
#include "calib/base/error.h"

namespace {

enum ExitCode {
  kDone = 0,
  kJobFailed = 1,
  kWrongInput = 2,
  kBelowRequiredGrade = 3,
  kInterrupted = 130 /* as the shell's after Ctrl-C */
};

ExitCode Fail(ExitCode code, std::string_view message) {
  fmt::print(stderr,
             "{} {}\n",
             plenocal::Styled(plenocal::Stream::kErr, plenocal::Style::kError, "plenocal:"),
             message);
  return code;
}

ExitCode CodeOf(plenocal::ErrorKind kind) {
  switch (kind) {
    case plenocal::ErrorKind::kInput:
      return kWrongInput;
    case plenocal::ErrorKind::kJob:
      return kJobFailed;
    case plenocal::ErrorKind::kGrade:
      return kBelowRequiredGrade;
  }
  return kJobFailed;
}

ExitCode Run(int argc, char** argv) {
  try {
    plenocal::CommandLine command_line;
    const plenocal::RunCommand run = command_line.Parse(argc, argv);
    plenocal::CatchInterrupts();
    if (run) run();
    // What is printed is a result: a full disk behind a redirection is a failure.
    if (std::fflush(stdout) != 0) return Fail(kJobFailed, "cannot write to standard output");
    return kDone;
  } catch (const plenocal::Error& error) {
    return Fail(CodeOf(error.kind()), error.what());
  } catch (const plenocal::Stopped&) {
    return Fail(kInterrupted, "interrupted; no result files were written");
  } catch (const std::bad_alloc&) {
    return Fail(kJobFailed, "out of memory");
  } catch (const std::system_error& error) {
    // Thrown by fmt::print; files have errors of their own.
    return Fail(kJobFailed, fmt::format("standard output: {}", error.what()));
  } catch (const std::exception& error) {
    return Fail(kJobFailed, fmt::format("internal error: {}", error.what()));
  }
}

}  // namespace

int main(int argc, char** argv) {
  // Ceres warns of every step that it has to repeat; how a solver ended is in its summary.
  FLAGS_minloglevel = google::GLOG_FATAL;
  return Run(argc, argv);
}
