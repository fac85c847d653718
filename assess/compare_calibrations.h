// SPDX-License-Identifier: Apache-2.0
//
// Two calibrations of the same cameras, camera by camera.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "assess/compare.h"
#include "assess/space/compare_in_space.h"

namespace plenocal {

/// Differences of the cameras that two calibrations have in common.
struct CalibrationComparison {
  std::vector<CalibratedCamera> a;  ///< the cameras that both calibrations have
  std::vector<CalibratedCamera> b;
  std::vector<CameraDifference> differences;
  std::vector<ExtrinsicsDifference> extrinsics;  ///< of all cameras but the first
  bool has_correlations = true;                  ///< between cameras, of both
  std::vector<std::string> only_a, only_b;       ///< names of cameras without a counterpart
  std::optional<SpaceComparison> space = {};     ///< not set: it was not asked for
};

/// Compares the cameras of equal names; single cameras whatever they are called. `distances` of the
/// scene, m; empty: 1 m and infinity. Throws `Error` of kind kInput as `CompareCameras`, and for
/// calibrations without a camera in common.
CalibrationComparison CompareCalibrations(const CalibrationRecord& a,
                                          const CalibrationRecord& b,
                                          std::vector<double> distances);

/// Gives cameras of `calibration` the names of their counterparts in `others`, as the entries
/// OTHER=OWN of `map` state. Throws `Error` of kind kInput for entries that do not fit.
void RenameCameras(const std::vector<std::string>& map,
                   const std::vector<std::string_view>& others,
                   CalibrationRecord* calibration);

/// "name counterparts by --map, for instance --map left=cam0,right=cam1" for cameras without equal
/// names.
std::string MapSuggestion(const std::vector<std::string>& a, const std::vector<std::string>& b);

}  // namespace plenocal
