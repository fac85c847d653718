// SPDX-License-Identifier: Apache-2.0
//
// Targets of one session that a detector may take for each other.
#pragma once

#include <span>
#include <vector>

#include "calib/files/session.h"
#include "calib/rig/identical_boards.h"
#include "detectors/images/other_targets.h"
#include "targets/target.h"

namespace plenocal {

/// The targets that only their mutual pose distinguishes. Throws `Error` of kind kInput for targets
/// that nothing distinguishes: boards of the same pattern, three of one print, such of which one
/// moves, and targets that share numbers of tags before a plenoptic camera. `targets`: those of the
/// session, in its order.
std::vector<IdenticalBoards> CheckDistinct(const Session& session, std::span<const Target> targets);

/// The targets whose tags or grids a detector of target `k` must not take for its own: all others
/// of its type and family, if any two of these share numbers of markers.
OtherTargets OtherTargetsOf(std::span<const Target> targets, size_t k);

}  // namespace plenocal
