// SPDX-License-Identifier: Apache-2.0
//
// Several calibrations of one rig in files as one.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/run.h"
#include "calib/prior/merge.h"

namespace plenocal {

struct MergeRequest {
  std::vector<std::filesystem::path> calibrations;  ///< folders, or their calibration.yaml
  std::vector<std::string> moved;                   ///< cameras that moved on the rig between them
  std::filesystem::path out;  ///< folder for the results; empty: none is written
};

struct MergedFiles {
  MergedCalibrations merged;
  std::vector<std::string> names;  ///< paths of the calibrations
};

/// Throws `Error` of kind kInput, also for a calibration that is given twice, by itself or as what
/// another was calibrated from.
MergedFiles MergeFiles(const MergeRequest& request, const Run& run);

/// For the terminal.
std::string MergeText(const MergedFiles& result);

}  // namespace plenocal
