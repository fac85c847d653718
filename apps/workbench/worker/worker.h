// SPDX-License-Identifier: Apache-2.0
//
// Runs the workbench's jobs with the engine, in a process of its own.
#pragma once

#include <nlohmann/json.hpp>

#include "calib/base/run.h"

namespace plenocal::workbench {

/// File descriptor, in the worker's process, of the socket to the workbench.
inline constexpr int kWorkerSocket = 3;

/// Runs one job and writes its results: `kind` "init", "detect", "calibrate", "try" or "focus",
/// `input` and the long options of that command. Throws `Error`, and `Stopped`.
void RunJob(const nlohmann::json& job, const Run& run);

/// Runs the jobs that come over `socket` one after the other until the other end is closed, then
/// closes it. A message is a job for `RunJob`, or `{"stop": true}` to stop the running one. Answers
/// with events (docs/guide.md, "--events"). The last event of a job is {"event": "end", "error":
/// the reason of a failure or stop, or "", "last": whether this process ends now}.
void ServeJobs(int socket);

}  // namespace plenocal::workbench
