// SPDX-License-Identifier: Apache-2.0
//
// Choice of the camera model and of the target's treatment by held-out frames.
#pragma once

#include <optional>

#include "calib/base/run.h"
#include "calib/files/session.h"
#include "engine/observe/session_observations.h"
#include "targets/target.h"

namespace plenocal {

/// Camera model and treatment of the target for images that come without a session file.
struct ImageChoice {
  const CameraModel* model = nullptr;
  std::optional<bool> refine_target = {};  ///< empty: as the target's file has it
};

/// Model and target that predict held-out frames best, of a few common models the simplest that is
/// not worse; the target is rigid or refined unless its file states a tolerance. Prints one line on
/// each. `model`: the user's; null: to be chosen.
ImageChoice ChooseByHeldOutFrames(const CameraModel* model,
                                  const Target& target,
                                  const SessionObservations& observations,
                                  const Run& run);

/// The model with which images are detected, and calibrated when they are too few for a choice.
const CameraModel& UsualModel();
/// The session with `usual` for the cameras in memory for which no model is given.
Session WithUsualModels(Session session, const CameraModel& usual = UsualModel());

/// Gives the cameras the models and what else `session` has for them.
void UseCamerasOf(const Session& session, SessionObservations* observations);

}  // namespace plenocal
