// SPDX-License-Identifier: Apache-2.0
//
// Runs the workbench's jobs by the engine, in a process of their own.
#pragma once

#include <nlohmann/json.hpp>

#include "calib/base/run.h"

namespace plenocal::workbench {

/// Number of the socket to the workbench in the worker's process.
inline constexpr int kWorkerSocket = 3;

/// Runs one job and writes its results: `kind` "init", "detect", "calibrate", "try" or "focus",
/// `input` and the long options of that command. Throws `Error`, and `Stopped`.
void RunJob(const nlohmann::json& job, const Run& run);

/// Runs the jobs that come over `socket`, which it closes, one after the other, until there come no
/// more: each a message as `RunJob` takes it, `{"stop": true}` stops the running one. Answers with
/// events (docs/guide.md, "--events"), the last of a job being {"event": "end", "error": why it
/// failed or was stopped, or "", "last": whether it is to be the last of this process}.
void ServeJobs(int socket);

}  // namespace plenocal::workbench
