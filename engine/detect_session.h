// SPDX-License-Identifier: Apache-2.0
//
// The target in all images of a session.
#pragma once

#include <memory>

#include "calib/base/run.h"
#include "calib/files/session.h"
#include "engine/observe/session_observations.h"
#include "engine/session/run_folders.h"
#include "engine/session/session_options.h"

namespace plenocal {

struct DetectedSession {
  Session session;
  SessionObservations observations;
  std::unique_ptr<RunFolders> folders;
};

/// Throws `Error`, and `Stopped`.
DetectedSession DetectSession(const Session& session,
                              const SessionOptions& options,
                              const Run& run);

}  // namespace plenocal
