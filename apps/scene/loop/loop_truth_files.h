// SPDX-License-Identifier: Apache-2.0
//
// The result files of `groundtruth` (docs/formats.md).
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

#include "apps/scene/loop/loop_truth.h"

namespace plenocal {

/// What the files need besides the result.
struct LoopTruthContext {
  const SceneTracks* tracks = nullptr;
  cv::Mat descriptors = {};           ///< row i is of track i; empty: not known
  std::vector<std::string> findings;  ///< warnings, in sentences
  std::vector<std::pair<std::string, std::string>> provenance;
};

/// Path of one camera in both segments, lines "t x y z qx qy qz qw" of T_world_camera (TUM). The
/// number of the frame stands for a time that is not known.
std::string SegmentsText(const LoopTruthResult& truth, const SceneTracks& tracks, size_t camera);

/// What the result shows to be wrong or weak, in sentences with what to do.
std::vector<std::string> FindingsOf(const LoopTruthResult& truth);

/// Floor of the alignment error of loops of some lengths (circles): (m, m).
std::vector<std::pair<double, double>> AlignmentFloors(const LoopTruthResult& truth);

/// Names and contents of all result files but the report.
std::vector<std::pair<std::string, std::string>> LoopTruthFiles(const LoopTruthResult& truth,
                                                                const LoopTruthContext& context);

/// For the terminal: scale, alignment, points, in lines.
std::string LoopTruthSummary(const LoopTruthResult& truth);

}  // namespace plenocal
