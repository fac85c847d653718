// SPDX-License-Identifier: Apache-2.0
//
// Comparisons of calibrations, and checks with new images, in words and tables.
#pragma once

#include <string>

#include "assess/check.h"
#include "assess/compare_calibrations.h"

namespace plenocal {

/// For the terminal: parameters, differences in the image, extrinsics, what has no counterpart, and
/// whether both are the same. `a`, `b`: names of the two.
std::string ComparisonText(const CalibrationComparison& comparison,
                           const std::string& a,
                           const std::string& b);
/// Content of compare.csv.
std::string ComparisonCsv(const CalibrationComparison& comparison);

/// For the terminal, and content of compare_space.csv.
std::string SpaceText(const SpaceComparison& comparison);
std::string SpaceCsv(const SpaceComparison& comparison);

/// "0.5 m", "far away".
std::string DistanceText(double distance);

/// For the terminal: residuals of each camera, findings, verdict.
std::string CheckText(const CalibrationCheck& check);

}  // namespace plenocal
