// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>
#include <glog/logging.h>

#include <cstdio>
#include <exception>
#include <filesystem>
#include <new>
#include <string_view>
#include <system_error>

#include "apps/cli/command_line.h"
#include "apps/cli/console.h"
#include "calib/base/error.h"
#include "calib/base/quoted_text.h"

namespace {

int Fail(int status, std::string_view message) {
  plenocal::PrintError(
      fmt::format("{} {}\n",
                  plenocal::Styled(plenocal::Stream::kErr, plenocal::Style::kError, "plenocal:"),
                  plenocal::Escaped(message)));
  return status;
}

int StatusOf(plenocal::ErrorKind kind) {
  constexpr int kWrongInput = 2, kBelowRequiredGrade = 3;
  switch (kind) {
    case plenocal::ErrorKind::kInput:
      return kWrongInput;
    case plenocal::ErrorKind::kJob:
      return plenocal::kJobFailedStatus;
    case plenocal::ErrorKind::kGrade:
      return kBelowRequiredGrade;
  }
  return plenocal::kJobFailedStatus;
}

int Run(int argc, char** argv) {
  constexpr int kFailed = plenocal::kJobFailedStatus;
  try {
    plenocal::CommandLine command_line;
    const plenocal::RunCommand run = command_line.Parse(argc, argv);
    plenocal::CatchInterrupts();
    if (run) run();
    // What is printed is a result: a full disk behind a redirection is a failure.
    if (std::fflush(stdout) != 0) return Fail(kFailed, "cannot write to standard output");
    return 0;
  } catch (const plenocal::Error& error) {
    return Fail(StatusOf(error.kind()), error.what());
  } catch (const plenocal::Stopped&) {
    return Fail(plenocal::kInterruptedStatus, plenocal::kInterrupted);
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

int main(int argc, char** argv) {
  plenocal::OpenStandardStreams();
  // Ceres warns of every step that it has to repeat; how a solver ended is in its summary.
  FLAGS_minloglevel = google::GLOG_FATAL;
  return Run(argc, argv);
}
