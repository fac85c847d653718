// SPDX-License-Identifier: Apache-2.0
//
// From a recording of a loop to its ground truth.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/groundtruth/loop_truth.h"
#include "apps/groundtruth/segments.h"
#include "calib/base/run.h"

namespace plenocal {

struct GroundtruthRequest {
  std::filesystem::path recording;
  std::filesystem::path calibration;  ///< empty: that of the recording
  std::vector<std::string> cameras;   ///< empty: those of the calibration that the recording has
  SegmentChoice segments;
  int points = 1000;          ///< followed at a time
  std::filesystem::path out;  ///< folder for the results; empty: none is written
};

/// Throws `Error`, and `Stopped`.
LoopTruthResult EstimateRecordedLoop(const GroundtruthRequest& request, const Run& run);

}  // namespace plenocal
