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

/// The targets of which a detector of target `k` must tell its own tags: all others of its family
/// or dictionary, if any two of these share numbers. Empty: it needs no other target.
std::vector<Target> RivalsOf(std::span<const Target> targets, size_t k);

}  // namespace plenocal
