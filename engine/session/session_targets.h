// SPDX-License-Identifier: Apache-2.0
//
// The targets of a session, one or several.
#pragma once

#include <string>
#include <vector>

#include "calib/estimate/calibrate.h"
#include "calib/files/calibration_record.h"
#include "calib/files/session.h"
#include "calib/rig/identical_boards.h"
#include "targets/target.h"

namespace plenocal {

struct SessionTargets {
  /// The only target. Of several: type `markers` with all of them, each in its target's own frame,
  /// numbered by `MarkerId`.
  Target all;
  std::vector<Target> several;  ///< empty: one
  /// Pairs of targets that only their mutual pose distinguishes.
  std::vector<IdenticalBoards> identical_boards;
};

/// Reads the target files of a session. Throws `Error` for files that cannot be read, and for
/// targets that no image distinguishes.
SessionTargets ReadSessionTargets(const Session& session);

/// Whether the target has the markers, as corners of a tag where the position is named so.
bool HasPosition(const Target& target, const ScenePosition& position);

/// Throws `Error` of kind kInput when the session has several targets, which `command` does not
/// take.
void RefuseSeveralTargets(const Session& session, const char* command);

/// The session's targets with their poses (known, fixed or free), for `CalibrationInput::targets`.
std::vector<InputTarget> InputTargetsOf(const Session& session);

/// The observations of each target in turn, as those of one camera with several targets: by frame,
/// with the numbers of `SessionTargets::all`.
std::vector<View> JoinViews(std::vector<std::vector<View>> by_target);

/// The markers where the calibration has placed them, in the frame of the first target.
Target PlacedTogether(const CalibrationRecord& record);

/// Text of the refined target `k` in its own frame.
std::string RefinedTargetOf(const CalibrationRecord& record, const Target& target, size_t k);

}  // namespace plenocal
