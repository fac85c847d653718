// SPDX-License-Identifier: Apache-2.0
//
// Choice of the camera model and of the target's treatment by held-out frames.
#pragma once

#include <optional>

#include "calib/base/run.h"
#include "calib/files/finding.h"
#include "calib/files/session.h"
#include "engine/observe/session_observations.h"
#include "targets/target.h"

namespace plenocal {

/// Chooses what a session leaves open, as `try` recommends it (`TryModelsAndTarget`, of the common
/// models): one model for all cameras with `auto_model`; a rigid or a refined target, unless its
/// file states a tolerance. Session and observations have the choice then. Returns it as a note
/// with its reasons; nothing: the session leaves nothing open.
std::optional<Finding> ChooseByHeldOutFrames(const Target& target,
                                             const Run& run,
                                             Session* session,
                                             SessionObservations* observations);

}  // namespace plenocal
