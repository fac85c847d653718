// SPDX-License-Identifier: Apache-2.0
//
// What the data determine badly or not at all, in words, with what to do about it.
#pragma once

#include <string>
#include <vector>

#include "calib/calibrate.h"

namespace plenocal {

/// Some unknowns and what is wrong with them.
struct WeakUnknowns {
  bool open = false;               ///< not determined; else only badly
  std::vector<std::string> names;  ///< "left.f_x"
  std::string what;                ///< "uncertain by 3.2 times their own size"
  std::string remedy;              ///< what to do, in sentences; ends in a full stop
};

/// First the open directions, then what is weak: parameters of one camera that correlate by more
/// than 0.99 with each other, and single ones whose sigma is more than a tenth of their size
/// (`Param::scale`). Of the coefficients of a field (`Param::prior_sigma`) those whose prior tells
/// more than the images: their sigma is above 0.7 of it. Remedies come from the camera models.
std::vector<WeakUnknowns> FindWeakUnknowns(const Calibration& calibration);

/// "a, b, c", of many the first few and how many more.
std::string Listed(const std::vector<std::string>& names);

}  // namespace plenocal
