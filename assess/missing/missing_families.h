// SPDX-License-Identifier: Apache-2.0
//
// What a camera model lacks: score tests of families of fields that the residuals of a finished
// calibration may contain (Rao 1948), without another adjustment.
#pragma once

#include <string>
#include <vector>

#include "calib/estimate/calibrate.h"

namespace plenocal {

/// A family that the residuals contain, given those before it in the list.
struct MissingFamily {
  std::string camera;
  std::string family;      ///< "radial", "decentring", "prism", "tilt", "skew", "local" or "board"
  std::string what;        ///< in words
  std::string remedy;      ///< the model to try, or what to do
  int degrees = 0;         ///< of the fields that the present unknowns cannot replace
  double probability = 1;  ///< of so large a score by noise, corrected for the number of families
  double gain = 0;         ///< root mean square length of the residuals that it explains, px
};

/// Of one ordinary camera that was calibrated; in the order of what each explains. Empty where
/// nothing is missing that 5 % false alarms in all show, and for fewer than 4 views. Two forms of
/// each test count, for independent points and for errors that the points of a view share, of which
/// the larger probability is taken.
std::vector<MissingFamily> FindMissingFamilies(const Calibration& calibration, size_t camera);

/// "left: radial terms ... (p = 1e-6, 0.11 px); try pinhole-radtan8." of each, a line.
std::string MissingText(const std::vector<MissingFamily>& missing);

}  // namespace plenocal
