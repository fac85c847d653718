// SPDX-License-Identifier: Apache-2.0
//
// Detection of the target in the images of a session, in all or in a part of them.
#pragma once

#include <cstddef>
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

/// Part `number` of `count` of the images of each camera: those with index % count = number - 1.
struct Shard {
  size_t number = 1, count = 1;
};

/// Detects in the images of a shard, for the cache of `options` alone, and writes OUT/shard.csv,
/// the number of points of each image. Throws `Error`, and `Stopped`.
void DetectShard(Session session,
                 const SessionOptions& options,
                 const Shard& shard,
                 const Run& run);

}  // namespace plenocal
