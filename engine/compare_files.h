// SPDX-License-Identifier: Apache-2.0
//
// Comparison of two calibrations in files.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "assess/compare_calibrations.h"

namespace plenocal {

/// What two calibrations are compared by.
struct ComparedBy {
  /// As `RenameCameras`: cameras of the one and their counterparts in the other calibration.
  std::vector<std::string> map;
  std::vector<double> distances;  ///< of the scene, m; empty: 1 m and infinity
  bool in_space = false;          ///< also in space, at the finite ones of these distances
  double bar = 0.1;               ///< length that is compared there, m
};

/// In space at the finite distances, or 1 m; micro images as in the folder of `a`.
SpaceComparison CompareInSpace(const CalibrationRecord& a,
                               const CalibrationRecord& b,
                               const ComparedBy& by);

/// Of two calibration.yaml. Throws `Error` of kind kInput for files that cannot be read or
/// compared.
CalibrationComparison CompareFiles(const std::filesystem::path& a,
                                   const std::filesystem::path& b,
                                   const ComparedBy& by);

}  // namespace plenocal
