// SPDX-License-Identifier: Apache-2.0
//
// Difference between two calibrations of the same cameras in space.
#pragma once

#include <string>
#include <vector>

#include "assess/views/micro_lens_visibility.h"
#include "calib/files/calibration_record.h"

namespace plenocal {

/// One number of the points that a set of cameras sees at one distance.
struct SpaceDifference {
  std::vector<std::string> cameras;
  double distance = 0;   ///< z in the first camera's frame, m
  std::string quantity;  ///< "z", "lateral" (length of x and y), or "bar"
  int points = 0;
  double rms = 0, largest = 0;  ///< m
  double predicted = 0;         ///< rms by the standard errors of both, m
  double probability = 1;       ///< of a larger rms by these alone
  bool differs = false;         ///< by more than they explain
};

struct SpaceComparison {
  std::vector<SpaceDifference> differences;
  double bar = 0;               ///< m
  bool has_prediction = false;  ///< one has standard errors, or both; else it is exact
  bool same = false;            ///< nothing differs, with one false alarm in a hundred comparisons
};

/// Points before the images of `a` are found by `b` from the places at which `a` sees them, less
/// the best rigid motion of each set of cameras, in which poses of the target follow. Prediction as
/// in `CompareCameras`. `lenses`: micro images of each camera of `a`; `distances`, m; `bar`: a
/// length parallel to the image, m. Throws `Error` of kind kInput where the two have no cameras in
/// common that measure points.
SpaceComparison CompareInSpace(const CalibrationRecord& a,
                               const CalibrationRecord& b,
                               const std::vector<MicroLensVisibility>& lenses,
                               const std::vector<double>& distances,
                               double bar);

}  // namespace plenocal
