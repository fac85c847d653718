// SPDX-License-Identifier: Apache-2.0
//
// Candidates of a choice of views: for which estimates they stay, and those that are kept.
#pragma once

#include <cstddef>
#include <vector>

#include "assess/views/rig_estimate.h"
#include "assess/views/target_poses.h"

namespace plenocal {

/// Properties of a camera on which candidates before it and their information depend.
struct CandidateBasis {
  std::vector<double> params;
  std::vector<bool> fixed;
  double sigma_px = 0;
  ViewRange range;
};

/// True if candidates that were made for some cameras are right for these, too: the same parameters
/// are free and within 1 % of their unit, noise and distances are within 5 %. `unknowns` of both.
bool CandidatesStay(const std::vector<CandidateBasis>& made_for,
                    const std::vector<CandidateBasis>& cameras,
                    const RigUnknowns& unknowns);

/// Indices (best first) without those to be left out: the first `all` stay, and behind them so many
/// of each camera and ninth of its image that `all` are spread over these, plus one.
std::vector<size_t> KeepSpread(std::vector<size_t> best,
                               const std::vector<TargetPose>& poses,
                               const std::vector<ImageSize>& image_sizes,
                               size_t all);

/// Distances at which the projection is to be judged for targets in these ranges of the cameras, m:
/// the nearest, the farthest and ten times that; of a plenoptic rig the middle of 1 / z in place of
/// the last.
std::vector<double> JudgedDistances(const std::vector<CandidateBasis>& cameras, bool plenoptic);

}  // namespace plenocal
