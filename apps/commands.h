// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "apps/console.h"

namespace plenocal {

// Each command throws `Error`, or `Stopped` after Ctrl-C; main maps both to the exit status.

struct SessionCommand {
  std::filesystem::path session;
  std::filesystem::path out;
};

/// `plenocal calibrate`: images or detections to calibration.
void RunCalibrate(const SessionCommand& command, const ConsoleOptions& options);
/// `plenocal detect`: only the detections.
void RunDetect(const SessionCommand& command, const ConsoleOptions& options);
/// `plenocal models`: the registered camera models on standard output.
void RunModels();

}  // namespace plenocal
