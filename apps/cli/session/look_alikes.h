// SPDX-License-Identifier: Apache-2.0
//
// Targets of one session that a detector may take for each other.
#pragma once

#include <span>
#include <vector>

#include "calib/files/session.h"
#include "targets/target.h"

namespace plenocal {

/// Throws `Error` of kind kInput for two targets that no image tells apart, and for two that share
/// numbers of tags before a plenoptic camera. `targets`: those of the session, in its order.
void CheckDistinct(const Session& session, std::span<const Target> targets);

/// The targets whose tags or grids a detector of target `k` must not take for its own: all others of
/// its type and family, if any two of these share numbers of markers. Empty: there are none.
std::vector<Target> RivalsOf(std::span<const Target> targets, size_t k);

}  // namespace plenocal
