// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "apps/console.h"
#include "calib/session.h"
#include "calib/start.h"
#include "targets/target.h"

namespace plenocal {

/// All observations of a session's cameras, from their images or detection files.
struct SessionObservations {
  std::vector<CameraInput> cameras;
  std::vector<LeftOut> left_out;
};

/// Reads or detects them, tells `console` one line a camera, and throws `Stopped` after Ctrl-C. Throws
/// `Error` when no camera of the session sees the target.
SessionObservations CollectObservations(const Session& session,
                                        const Target& target,
                                        const ConsoleOptions& options,
                                        Console* console);

}  // namespace plenocal
