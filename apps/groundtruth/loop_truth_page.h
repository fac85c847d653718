// SPDX-License-Identifier: Apache-2.0
//
// The page of a loop's ground truth.
#pragma once

#include <string>

#include "apps/groundtruth/loop_truth_files.h"

namespace plenocal {

/// report.html of `groundtruth`: what is known how well, points and paths in space, errors of the
/// frames.
std::string LoopTruthPage(const LoopTruthResult& truth, const LoopTruthContext& context);

}  // namespace plenocal
